#include "text.h"

#include "crc16.h"

namespace coilarray {

static const char kDigits[] = "0123456789ABCDEF";

void Text::clear() {
    length_ = 0;
    overflowed_ = false;
}

void Text::add(char character) {
    if (length_ > kLongestLine - kSeal) {
        overflowed_ = true;
        return;
    }
    data_[length_++] = character;
}

void Text::add(const char* text) {
    while (*text != '\0') {
        add(*text++);
    }
}

void Text::add_hex(uint32_t value, uint8_t digits) {
    while (digits-- > 0) {
        add(kDigits[(value >> (4 * digits)) & 0x0F]);
    }
}

void Text::add_decimal(uint32_t value) {
    char reversed[10];
    uint8_t count = 0;
    do {
        reversed[count++] = kDigits[value % 10];
        value /= 10;
    } while (value != 0);
    while (count > 0) {
        add(reversed[--count]);
    }
}

void Text::seal() {
    const uint16_t crc = crc16(data_, length_);
    data_[length_++] = '*';
    for (uint8_t digit = 4; digit-- > 0;) {
        data_[length_++] = kDigits[(crc >> (4 * digit)) & 0x0F];
    }
    data_[length_++] = '\n';
}

}  // namespace coilarray
