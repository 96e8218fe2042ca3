"""Protocol between computer and board.

It is defined in `hardware/firmware/PROTOCOL.md`. The package converts bytes to messages and opens no port.
"""
