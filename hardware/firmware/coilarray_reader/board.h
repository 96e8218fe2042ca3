// What this firmware and the board that it was made for are, before the computer says anything.
#pragma once

#include <stdint.h>

#include "bounds.h"

namespace coilarray {

constexpr char kProtocol[] = "2.0";
constexpr char kFirmware[] = "coilarray-reader-2.0";

// One ADG739 a coil, wired as `hardware/wirings/six_coils.toml`: both ends of every coil to ground. Another board needs
// its own words here, because they are sent before the computer can say what is wired.
constexpr uint8_t kDefaultDevices = 6;
constexpr uint8_t kDefaultSafeWords[kDefaultDevices] = {0x11, 0x11, 0x11, 0x11, 0x11, 0x11};

constexpr uint32_t kBaud = 115200;

// Pins by their Arduino numbers on the XMC 2Go.
constexpr uint8_t kSclPin = 10;  // P2.11, pull-up needed
constexpr uint8_t kSdaPin = 11;  // P2.10, pull-up needed
constexpr uint8_t kDinPin = 1;   // P0.7
constexpr uint8_t kSclkPin = 2;  // P0.8
constexpr uint8_t kSyncPin = 3;  // P0.9
// DOUT of the last device, wired back to P0.6 with a pull-up: 0. Not wired back: kNoPin.
constexpr uint8_t kNoPin = 255;
constexpr uint8_t kDoutPin = kNoPin;

constexpr uint8_t kConverterAddress = 0x2A;  // its pin ADDR at ground; 0x2B at supply
constexpr uint8_t kHalfClock = 1;            // of SCL, in microseconds, added to what the calls take
constexpr uint32_t kBusGuard = 1000;         // microseconds until a line that is held down gives up a transfer
constexpr uint32_t kClockSlip = 500;         // microseconds; two readings of the clock in a row lie closer together

}  // namespace coilarray
