"""The protocol between computer and board (`hardware/firmware/PROTOCOL.md`): bytes in, messages out, no port."""

from coilarray.hardware.wire.protocol.board_time import BoardTime
from coilarray.hardware.wire.protocol.commands import command_line, draft_commands
from coilarray.hardware.wire.protocol.lines import MAX_LINE, LineCounts, LineParser, seal
from coilarray.hardware.wire.protocol.messages import (
    Answer,
    Heartbeat,
    Message,
    MessageError,
    Mode,
    Refusal,
    ScanMessage,
    StreamEnd,
    StreamEndReason,
    parse_message,
    read_scan,
)
from coilarray.hardware.wire.protocol.replies import VERSION, Greeting, Pong, read_greeting, read_pong
from coilarray.hardware.wire.protocol.scan_gate import GateCounts, ScanGate

__all__ = [
    "MAX_LINE",
    "VERSION",
    "Answer",
    "BoardTime",
    "GateCounts",
    "Greeting",
    "Heartbeat",
    "LineCounts",
    "LineParser",
    "Message",
    "MessageError",
    "Mode",
    "Pong",
    "Refusal",
    "ScanGate",
    "ScanMessage",
    "StreamEnd",
    "StreamEndReason",
    "command_line",
    "draft_commands",
    "parse_message",
    "read_greeting",
    "read_pong",
    "read_scan",
    "seal",
]
