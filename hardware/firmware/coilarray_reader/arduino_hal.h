// The pins of the microcontroller through Arduino's own functions.
//
// Both buses are made by hand. The XMC1100 has one serial unit with two channels, and the port to the computer takes
// one of them, so I2C and SPI could not both be hardware; and the core's I2C waits for seconds on a bus that hangs and
// does not tell a missing acknowledgement from it.
#pragma once

#include <stdint.h>

#include "hal.h"

namespace coilarray {

class ArduinoHal final : public Hal {
  public:
    // Pins to their states at rest.
    void begin();

    uint32_t micros() override;
    Transfer read_register(uint8_t address, uint16_t& value) override;
    Transfer write_register(uint8_t address, uint16_t value) override;
    void clear_bus() override;
    bool shift(const uint8_t* words, uint8_t count, uint8_t* before) override;
    int receive() override;
    uint32_t send_wait() override;
    void send(uint8_t byte) override;
    uint32_t boot_number() override;

  private:
    // Each returns kDone, or what ended the transfer.
    Transfer start_condition();
    Transfer write_byte(uint8_t byte);
    Transfer read_byte(uint8_t& byte, bool acknowledge);
    Transfer stop_condition();
    Transfer raise_clock();
    // Ends a transfer, also one that failed.
    Transfer end_transfer(Transfer result);
};

}  // namespace coilarray
