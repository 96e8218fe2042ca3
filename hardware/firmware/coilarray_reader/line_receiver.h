// Finds intact lines in whatever bytes come.
#pragma once

#include <stdint.h>

#include "bounds.h"

namespace coilarray {

class LineReceiver {
  public:
    // Takes a byte; true when it ended an intact line, which then stands in text() until the next byte.
    bool take(uint8_t byte);

    const char* text() const { return data_; }  // without its checksum, ended by NUL
    uint16_t crc() const { return crc_; }
    uint32_t dropped() const { return dropped_; }
    void count_dropped() { ++dropped_; }

  private:
    bool end_line();

    char data_[kLongestLine + 2];  // a carriage return may stand before the line feed
    uint16_t length_ = 0;
    bool spoiled_ = false;  // too long, or with another character
    uint16_t crc_ = 0;
    uint32_t dropped_ = 0;
};

}  // namespace coilarray
