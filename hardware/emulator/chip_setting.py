"""Registers of an LDC1614 as they were when it was woken, taken apart and judged."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

DEGLITCH = {0b001: 1e6, 0b100: 3.3e6, 0b101: 10e6, 0b111: 33e6}
"""Input filters in Hz by code; the application table prints 0b011 for the last."""
_SEQUENCES = {0b00: 2, 0b01: 3, 0b10: 4, 0b11: 2}  # channels of RR_SEQUENCE
_LARGEST_REFERENCE_SINGLE, _LARGEST_REFERENCE_SCAN, _LARGEST_EXTERNAL_SCAN = 35e6, 55e6, 40e6


@dataclass(frozen=True)
class ChannelSetting:
    """Registers of one channel, taken apart."""

    rcount: int
    offset: int
    settle: int
    fin_divider: int
    fref_divider: int
    drive: int


@dataclass(frozen=True)
class Setting:
    """Registers as they were when the chip was woken, taken apart."""

    channels: tuple[ChannelSetting, ...]
    sequence: tuple[int, ...]
    external: bool
    fixed_drive: bool
    fixed_amplitude: bool
    high_current: bool
    deglitch: int

    @staticmethod
    def of(registers: Mapping[int, int], channels: int) -> Setting:
        """Take the registers of a chip with that many channels apart."""
        config, mux = registers[0x1A], registers[0x1B]
        scan = bool(mux >> 15)
        sequence = tuple(range(min(_SEQUENCES[mux >> 13 & 0b11], channels))) if scan else (config >> 14,)
        return Setting(
            channels=tuple(
                ChannelSetting(
                    registers[0x08 + k],
                    registers[0x0C + k],
                    registers[0x10 + k],
                    registers[0x14 + k] >> 12,
                    registers[0x14 + k] & 0x3FF,
                    registers[0x1E + k] >> 11,
                )
                for k in range(channels)
            ),
            sequence=sequence,
            external=bool(config >> 9 & 1),
            fixed_drive=bool(config >> 12 & 1),
            fixed_amplitude=bool(config >> 10 & 1),
            high_current=bool(config >> 6 & 1),
            deglitch=mux & 0b111,
        )

    @property
    def scan(self) -> bool:
        """Whether several channels take turns."""
        return len(self.sequence) > 1

    def problems(self, clock: float | None) -> Iterator[str]:
        """Say what of it the data sheet does not allow, with a clock in Hz; None where the chosen one is missing."""
        if clock is None:
            yield "the chip was woken with an external clock, but the pin CLKIN is grounded."
        if self.high_current and self.sequence != (0,):
            yield "HIGH_CURRENT_DRV was set although channel 0 is not the only one."
        if self.deglitch not in DEGLITCH:
            yield f"DEGLITCH is {self.deglitch:#05b}, which is reserved."
        for channel in self.sequence:
            if channel >= len(self.channels):
                yield f"channel {channel} was chosen; the chip has {len(self.channels)}."
                continue
            yield from self._channel_problems(channel, clock)

    def _channel_problems(self, channel: int, clock: float | None) -> Iterator[str]:
        one = self.channels[channel]
        if one.fin_divider == 0 or one.fref_divider == 0:
            yield f"CLOCK_DIVIDERS{channel} holds a divider 0, which is reserved."
            return
        if one.rcount <= (8 if self.scan else 4):
            yield f"RCOUNT{channel} is {one.rcount}, which is reserved."
        if self.scan and one.settle <= 3:
            yield f"SETTLECOUNT{channel} is {one.settle}; with several channels it must be more than 3."
        if clock is None:
            return
        reference = clock / one.fref_divider
        largest = _LARGEST_REFERENCE_SINGLE
        if self.scan:
            largest = _LARGEST_EXTERNAL_SCAN if self.external else _LARGEST_REFERENCE_SCAN
        if reference > largest:
            yield f"the reference of channel {channel} is {reference:.4g} Hz; at most {largest:.4g} Hz are allowed."
