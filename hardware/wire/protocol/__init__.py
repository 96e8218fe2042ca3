"""The protocol between computer and board (`hardware/firmware/PROTOCOL.md`): bytes in, messages out, no port."""
