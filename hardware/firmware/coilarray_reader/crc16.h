// CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, nothing reflected.
#pragma once

#include <stddef.h>
#include <stdint.h>

namespace coilarray {

class Crc16 {
  public:
    void add(uint8_t byte);
    void add(const uint8_t* bytes, size_t count);
    void add16(uint16_t value);  // high byte first
    void add32(uint32_t value);
    uint16_t value() const { return value_; }

  private:
    uint16_t value_ = 0xFFFF;
};

uint16_t crc16(const char* text, size_t length);

}  // namespace coilarray
