#include "fields.h"

namespace coilarray {

int8_t hex_digit(char character) {
    if (character >= '0' && character <= '9') {
        return static_cast<int8_t>(character - '0');
    }
    if (character >= 'A' && character <= 'F') {
        return static_cast<int8_t>(character - 'A' + 10);
    }
    return -1;
}

bool Fields::hex(uint8_t digits, uint32_t& value) {
    value = 0;
    const char* at = rest_;
    for (uint8_t i = 0; i < digits; ++i, ++at) {
        const int8_t digit = hex_digit(*at);
        if (digit < 0) {
            return false;
        }
        value = (value << 4) | static_cast<uint32_t>(digit);
    }
    rest_ = at;
    return end_field();
}

bool Fields::bytes(uint8_t* into, uint8_t count) {
    const char* at = rest_;
    for (uint8_t i = 0; i < count; ++i, at += 2) {
        const int8_t high = hex_digit(at[0]);
        const int8_t low = high < 0 ? int8_t{-1} : hex_digit(at[1]);  // at[1] is not looked at beyond the end
        if (low < 0) {
            return false;
        }
        into[i] = static_cast<uint8_t>((high << 4) | low);
    }
    rest_ = at;
    return end_field();
}

bool Fields::is(const char* word) {
    const char* at = rest_;
    while (*word != '\0' && *at == *word) {
        ++at;
        ++word;
    }
    if (*word != '\0' || (*at != ',' && *at != '\0')) {
        return false;
    }
    rest_ = at;
    return end_field();
}

uint8_t Fields::commas() const {
    uint8_t count = 0;
    for (const char* at = rest_; *at != '\0' && count < 255; ++at) {
        count = static_cast<uint8_t>(count + (*at == ','));
    }
    return count;
}

bool Fields::end_field() {
    if (*rest_ == ',') {
        ++rest_;
        return true;
    }
    return *rest_ == '\0';
}

}  // namespace coilarray
