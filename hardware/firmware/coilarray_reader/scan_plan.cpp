#include "scan_plan.h"

#include <string.h>

#include "chips.h"
#include "crc16.h"

namespace coilarray {

const uint8_t kRegisterAddresses[kRegisters] = {0x08, 0x0C, 0x10, 0x14, 0x19, 0x1A, 0x1B};

void ScanPlan::clear(uint8_t device_count, uint8_t state_count) {
    memset(this, 0, sizeof(*this));
    devices = device_count;
    states = state_count;
}

static uint32_t ones(uint8_t count) {
    return count >= 32 ? 0xFFFFFFFFu : (uint32_t{1} << count) - 1;
}

bool ScanPlan::complete() const {
    return has_safe && has_times && has_wiring == ones(devices) && has_state == ones(states) &&
           has_register == ones(kRegisters);
}

bool ScanPlan::own_drive() const {
    return (registers[kConfigIndex] & kFixedDrive) == 0;
}

uint16_t ScanPlan::hash() const {
    Crc16 crc;
    static const char kFormat[] = "coilarray1";
    crc.add(reinterpret_cast<const uint8_t*>(kFormat), sizeof(kFormat) - 1);
    crc.add(devices);
    for (uint8_t device = 0; device < devices; ++device) {
        crc.add(wiring[device], kSwitches);
    }
    crc.add(safe, devices);
    for (uint8_t i = 0; i < kRegisters; ++i) {
        crc.add(kRegisterAddresses[i]);
        crc.add16(registers[i]);
    }
    crc.add32(wait);
    crc.add32(timeout);
    if (discard > 0) {
        crc.add(discard);
        crc.add32(again);
    }
    crc.add(states);
    for (uint8_t i = 0; i < states; ++i) {
        crc.add(state[i].words, devices);
        crc.add16(state[i].drive);
    }
    return crc.value();
}

int8_t register_index(uint8_t address) {
    for (uint8_t i = 0; i < kRegisters; ++i) {
        if (kRegisterAddresses[i] == address) {
            return static_cast<int8_t>(i);
        }
    }
    return -1;
}

bool register_allowed(uint8_t address, uint16_t value) {
    switch (address) {
        case 0x08:  // RCOUNT0: 0 to 4 are reserved
            return value > 4;
        case 0x14:  // CLOCK_DIVIDERS0: neither divider 0
            return (value & 0x0C00) == 0 && (value & 0xF000) != 0 && (value & 0x03FF) != 0;
        case 0x19:  // ERROR_CONFIG
            return (value & 0x0702) == 0;
        case 0x1A:  // CONFIG: channel 0, awake
            return (value & 0xE13F) == 0x0001;
        case 0x1B:  // MUX_CONFIG: one channel
            return (value & 0x9FF8) == 0x0208;
        default:
            return true;
    }
}

}  // namespace coilarray
