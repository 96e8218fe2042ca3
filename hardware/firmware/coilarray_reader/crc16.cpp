#include "crc16.h"

namespace coilarray {

// Four bits at a time: half of a byte-wise table's work saved against single bits, for 32 bytes of flash.
static const uint16_t kNibbles[16] = {
    0x0000, 0x1021, 0x2042, 0x3063, 0x4084, 0x50A5, 0x60C6, 0x70E7,
    0x8108, 0x9129, 0xA14A, 0xB16B, 0xC18C, 0xD1AD, 0xE1CE, 0xF1EF,
};

static uint16_t add_nibble(uint16_t crc, uint8_t nibble) {
    return static_cast<uint16_t>((crc << 4) ^ kNibbles[((crc >> 12) ^ nibble) & 0x0F]);
}

void Crc16::add(uint8_t byte) {
    value_ = add_nibble(value_, static_cast<uint8_t>(byte >> 4));
    value_ = add_nibble(value_, static_cast<uint8_t>(byte & 0x0F));
}

void Crc16::add(const uint8_t* bytes, size_t count) {
    for (size_t i = 0; i < count; ++i) {
        add(bytes[i]);
    }
}

void Crc16::add16(uint16_t value) {
    add(static_cast<uint8_t>(value >> 8));
    add(static_cast<uint8_t>(value & 0xFF));
}

void Crc16::add32(uint32_t value) {
    add16(static_cast<uint16_t>(value >> 16));
    add16(static_cast<uint16_t>(value & 0xFFFF));
}

uint16_t crc16(const char* text, size_t length) {
    Crc16 crc;
    crc.add(reinterpret_cast<const uint8_t*>(text), length);
    return crc.value();
}

}  // namespace coilarray
