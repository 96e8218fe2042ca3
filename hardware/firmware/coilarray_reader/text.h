// A line being written, in bounded memory: what does not fit is left out and remembered.
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "bounds.h"

namespace coilarray {

class Text {
  public:
    void clear();
    void add(char character);
    void add(const char* text);
    void add_hex(uint32_t value, uint8_t digits);
    void add_decimal(uint32_t value);
    // Adds the checksum and the line feed; after it only data() and length() are of use.
    void seal();

    const char* data() const { return data_; }
    uint16_t length() const { return length_; }
    bool overflowed() const { return overflowed_; }

  private:
    static constexpr uint16_t kSeal = 6;  // `*`, four digits, line feed

    char data_[kLongestLine + 1];
    uint16_t length_ = 0;
    bool overflowed_ = false;
};

}  // namespace coilarray
