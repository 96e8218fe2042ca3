"""Connection to a board: ports, links and the protocol."""
