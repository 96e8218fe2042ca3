#include "line_receiver.h"

#include "crc16.h"
#include "fields.h"

namespace coilarray {

static const uint8_t kChecksum = 5;  // `*` and four digits

bool LineReceiver::take(uint8_t byte) {
    if (byte == '\n') {
        const bool intact = end_line();
        length_ = 0;
        spoiled_ = false;
        return intact;
    }
    if (length_ + 1u >= sizeof(data_)) {
        spoiled_ = true;
    } else {
        data_[length_++] = static_cast<char>(byte);
    }
    return false;
}

bool LineReceiver::end_line() {
    if (!spoiled_ && length_ > 0 && data_[length_ - 1] == '\r') {
        --length_;
    }
    if (!spoiled_ && length_ == 0) {
        return false;  // an empty line only ends what came before it
    }
    spoiled_ = spoiled_ || length_ > kLongestLine || length_ <= kChecksum;
    for (uint16_t i = 0; i < length_ && !spoiled_; ++i) {
        spoiled_ = data_[i] < 0x20 || data_[i] > 0x7E;
    }
    if (!spoiled_) {
        const uint16_t content = static_cast<uint16_t>(length_ - kChecksum);
        data_[length_] = '\0';
        uint32_t claimed = 0;
        Fields checksum(data_ + content + 1);
        crc_ = crc16(data_, content);
        spoiled_ = data_[content] != '*' || !checksum.hex(4, claimed) || claimed != crc_;
        data_[content] = '\0';
    }
    dropped_ += spoiled_;
    return !spoiled_;
}

}  // namespace coilarray
