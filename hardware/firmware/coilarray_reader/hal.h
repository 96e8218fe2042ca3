// All that the logic asks of the microcontroller. One implementation drives the pins (arduino_hal), one the tests.
#pragma once

#include <stdint.h>

namespace coilarray {

// How a transfer to the converter went; the numbers are those of the protocol's `!1` and `!2`.
enum class Transfer : uint8_t { kDone = 0, kNotAcknowledged = 1, kTimeout = 2 };

class Hal {
  public:
    // Microseconds since an arbitrary start; wraps at 2^32.
    virtual uint32_t micros() = 0;

    // A 16-bit register of the converter. Returns within a few milliseconds whatever the bus does.
    virtual Transfer read_register(uint8_t address, uint16_t& value) = 0;
    virtual Transfer write_register(uint8_t address, uint16_t value) = 0;
    // Frees a bus that the converter holds down: nine clocks and a stop.
    virtual void clear_bus() = 0;

    // Shifts one byte for each device, words[0] first, and latches all at once. Where the end of the chain is wired
    // back: puts into `before` what the chain held and returns true.
    virtual bool shift(const uint8_t* words, uint8_t count, uint8_t* before) = 0;

    // The next byte from the computer, or -1.
    virtual int receive() = 0;
    // Microseconds, roughly, until send() takes a byte without waiting; 0: now.
    virtual uint32_t send_wait() = 0;
    virtual void send(uint8_t byte) = 0;

    // Another number after every start.
    virtual uint32_t boot_number() = 0;

  protected:
    ~Hal() = default;
};

// Time from `since` to `now`, both of micros(). A clock that steps back a little has not moved.
inline uint32_t elapsed(uint32_t now, uint32_t since) {
    const uint32_t difference = now - since;
    return difference > 0x7FFFFFFFu ? 0 : difference;
}

}  // namespace coilarray
