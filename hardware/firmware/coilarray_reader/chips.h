// The two chips as a scan uses them: the converter that sleeps or converts, and the chain of switches.
#pragma once

#include <stdint.h>

#include "hal.h"
#include "bounds.h"

namespace coilarray {

constexpr uint8_t kDataMsb = 0x00, kDataLsb = 0x01, kStatus = 0x18, kConfig = 0x1A;
constexpr uint8_t kResetDevice = 0x1C, kDriveCurrent = 0x1E, kManufacturerId = 0x7E, kDeviceId = 0x7F;
constexpr uint16_t kManufacturer = 0x5449, kDevice = 0x3055;
constexpr uint16_t kDataReady = 0x0040;       // of STATUS
constexpr uint16_t kAsleep = 0x2000;          // of CONFIG
constexpr uint16_t kFixedDrive = 0x1000;      // of CONFIG; without it the converter chooses its own drive current
constexpr uint16_t kSleepingConfig = 0x2801;  // CONFIG after a reset

class Converter {
  public:
    explicit Converter(Hal& hal) : hal_(hal) {}

    // CONFIG of an active converter; asleep it has one bit more.
    void set_active_config(uint16_t value) { sleep_config_ = value | kAsleep; }
    void forget_config() { sleep_config_ = kSleepingConfig; }

    Transfer read(uint8_t address, uint16_t& value) { return hal_.read_register(address, value); }
    Transfer write(uint8_t address, uint16_t value) { return hal_.write_register(address, value); }
    Transfer wake();
    Transfer sleep();
    bool asleep() const { return asleep_; }
    // After a bus that hung: frees it and resets the converter, which then has lost its registers and sleeps.
    void recover();

  private:
    Hal& hal_;
    uint16_t sleep_config_ = kSleepingConfig;
    bool asleep_ = false;
};

class SwitchChain {
  public:
    explicit SwitchChain(Hal& hal) : hal_(hal) {}

    // Sends words. False where the chain is wired back and did not hold what it was sent before; means nothing for the
    // first words of all and the first of another number.
    bool send(const uint8_t* words, uint8_t count);
    bool open_all(uint8_t count);
    // Known after the first words were sent.
    bool wired_back() const { return wired_back_; }

  private:
    Hal& hal_;
    uint8_t last_[kMostDevices] = {0};
    bool wired_back_ = false;
};

}  // namespace coilarray
