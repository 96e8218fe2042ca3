// All that the computer tells before a scan: wiring, registers, states; and the hash that ties a reading to it.
#pragma once

#include <stdint.h>

#include "bounds.h"

namespace coilarray {

constexpr uint8_t kRegisters = 7;
// Addresses of the registers of a plan, ascending.
extern const uint8_t kRegisterAddresses[kRegisters];
constexpr uint8_t kConfigIndex = 5;    // of CONFIG among them
constexpr uint8_t kDividersIndex = 3;  // of CLOCK_DIVIDERS0

constexpr uint8_t kUnusedSwitch = 0xFF;

struct State {
    uint8_t words[kMostDevices];
    uint16_t drive;
};

struct ScanPlan {
    uint8_t devices;
    uint8_t states;
    uint8_t wiring[kMostDevices][kSwitches];  // 4 * terminal + net
    uint8_t safe[kMostDevices];
    uint16_t registers[kRegisters];
    uint32_t wait, timeout;  // microseconds
    uint8_t discard;         // conversions to throw away after waking
    uint32_t again;          // microseconds from such a one to the next look
    State state[kMostStates];

    // Which parts are there, one bit each.
    uint32_t has_wiring, has_state;
    uint8_t has_register;
    bool has_safe, has_times;

    void clear(uint8_t device_count, uint8_t state_count);
    bool complete() const;
    // Whether the converter chooses its drive currents itself.
    bool own_drive() const;
    uint16_t hash() const;
};

// Index of a register in a plan, or -1.
int8_t register_index(uint8_t address);
// Whether a value leaves the reserved fields of its register as they must be, with the one channel that is read.
bool register_allowed(uint8_t address, uint16_t value);

}  // namespace coilarray
