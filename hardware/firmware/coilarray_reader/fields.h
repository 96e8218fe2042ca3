// Reads the comma-separated fields of a received line. Every reader says whether the field was as it must be.
#pragma once

#include <stdint.h>

namespace coilarray {

class Fields {
  public:
    // `text` ends in NUL.
    explicit Fields(const char* text) : rest_(text) {}

    // A number of exactly `digits` upper-case hex digits.
    bool hex(uint8_t digits, uint32_t& value);
    // `count` bytes of two upper-case hex digits each.
    bool bytes(uint8_t* into, uint8_t count);
    // A field that is exactly `word`.
    bool is(const char* word);
    // Commas still to come: the number of fields after this one.
    uint8_t commas() const;

  private:
    bool end_field();

    const char* rest_;
};

// The value of an upper-case hex digit, or -1.
int8_t hex_digit(char character);

}  // namespace coilarray
