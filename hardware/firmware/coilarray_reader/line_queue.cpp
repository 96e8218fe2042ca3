#include "line_queue.h"

namespace coilarray {

void LineQueue::push(const char* line, uint16_t length) {
    if (length > kSize - count_) {
        return;
    }
    for (uint16_t i = 0; i < length; ++i) {
        data_[(first_ + count_) % kSize] = line[i];
        ++count_;
    }
}

uint8_t LineQueue::pop() {
    const uint8_t byte = static_cast<uint8_t>(data_[first_]);
    first_ = static_cast<uint16_t>((first_ + 1) % kSize);
    --count_;
    return byte;
}

}  // namespace coilarray
