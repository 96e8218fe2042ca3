// Whole lines on their way to the computer.
#pragma once

#include <stdint.h>

#include "bounds.h"

namespace coilarray {

class LineQueue {
  public:
    // Whether a line of any allowed length still fits.
    bool has_room() const { return kSize - count_ > kLongestLine; }
    // Takes a whole line, or, where it does not fit, nothing.
    void push(const char* line, uint16_t length);
    bool empty() const { return count_ == 0; }
    uint8_t pop();

  private:
    static constexpr uint16_t kSize = 1536;  // three of the longest lines

    char data_[kSize];
    uint16_t first_ = 0;
    uint16_t count_ = 0;
};

}  // namespace coilarray
