// What the firmware holds at most; every buffer is of one of these sizes.
#pragma once

#include <stdint.h>

namespace coilarray {

constexpr uint8_t kMostStates = 32;     // a scan of all of them is still one line
constexpr uint8_t kMostOwnDrives = 16;  // states where the converter chooses its own drive current
constexpr uint8_t kMostDiscarded = 15;  // conversions that are thrown away after waking
constexpr uint8_t kMostDevices = 16;    // 8 switches each; a switch names one of 63 terminals
constexpr uint8_t kSwitches = 8;        // of a device
constexpr uint16_t kLongestLine = 512;  // characters, checksum included, line feed not

}  // namespace coilarray
