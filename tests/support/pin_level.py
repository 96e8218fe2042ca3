"""Chips at the level of their pins: what an I²C slave and a chain of switches make of edges; for tests of drivers."""

from __future__ import annotations


class Registers:
    """An I²C slave with 16-bit registers behind an 8-bit pointer, as the LDC1614 is; knows nothing but edges.

    `line(scl, sda)` tells it the levels that the master drives; what it returns is the level of SDA on the wire.
    """

    def __init__(self, address, registers):
        self.address, self.registers = address, registers
        self.transfers = []
        """One entry for each START: address byte, then the bytes that followed."""
        self.stops = 0
        self._scl = self._sda = 1
        self._state, self._bits, self._out = "idle", [], []
        self._pull = 1  # what the slave drives: 0 holds the line down
        self._pointer = 0

    def line(self, scl, sda):
        wire = sda & self._pull
        if self._scl and scl:
            if self._sda and not wire:
                self._start()
            elif not self._sda and wire:
                self.stops += 1
                self._state, self._pull = "idle", 1
        elif not self._scl and scl:
            self._rise(wire)
        elif self._scl and not scl:
            self._fall()
        self._scl = scl
        self._sda = sda & self._pull
        return self._sda

    def _start(self):
        self._state, self._bits, self._pull = "address", [], 1
        self.transfers.append([])

    def _rise(self, wire):
        if self._state in ("address", "write"):
            self._bits.append(wire)
        elif self._state == "master acknowledges":
            self._more = wire == 0

    def _fall(self):
        if self._state in ("address", "write") and len(self._bits) == 8:
            byte = int("".join(map(str, self._bits)), 2)
            self.transfers[-1].append(byte)
            self._bits = []
            if self._state == "address":
                mine = byte >> 1 == self.address
                self._next = ("read" if byte & 1 else "write") if mine else "idle"
            else:
                self._take(len(self.transfers[-1]) - 1, byte)
                self._next, mine = "write", True
            self._pull = 0 if mine else 1
            self._state = "slave acknowledges"
        elif self._state == "slave acknowledges":
            self._state, self._pull = self._next, 1
            if self._state == "read":
                value = self.registers.get(self._pointer, 0)
                self._out = [value >> bit & 1 for bit in reversed(range(16))]
                self._sent = 0
                self._pull = self._out.pop(0)
        elif self._state == "read":
            self._sent += 1
            if self._sent % 8 == 0:
                self._state, self._pull = "master acknowledges", 1
            else:
                self._pull = self._out.pop(0)
        elif self._state == "master acknowledges":
            self._state = "read" if self._more and self._out else "idle"
            self._pull = self._out.pop(0) if self._state == "read" else 1

    def _take(self, place, byte):
        if place == 1:
            self._pointer = byte
        elif place == 2:
            self._high = byte
        elif place == 3:
            self.registers[self._pointer] = self._high << 8 | byte


class SwitchRegister:
    """A daisy chain of eight-switch packages: takes a bit at each falling edge, changes DOUT at each rising one."""

    def __init__(self, devices):
        self._bits = [0] * (8 * devices)  # the far end first
        self.clock, self.sync = 0, 1
        self.dout = 0
        self.latched = []
        self.clocks = 0

    def line(self, clock, data, sync):
        if not sync and not self.sync:
            if self.clock and not clock:
                self._bits = [*self._bits[1:], data]
                self.clocks += 1
            elif clock and not self.clock:
                self.dout = self._bits[0]
        elif sync and not self.sync:
            bits = self._bits
            self.latched.append(bytes(int("".join(map(str, bits[k : k + 8])), 2) for k in range(0, len(bits), 8)))
        self.clock, self.sync = clock, sync
