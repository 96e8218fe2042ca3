"""The bundled wirings, as TOML files."""
