#include "chips.h"

#include <string.h>

namespace coilarray {

Transfer Converter::wake() {
    asleep_ = false;  // also where the transfer fails: it may have got through
    return write(kConfig, sleep_config_ & static_cast<uint16_t>(~kAsleep));
}

Transfer Converter::sleep() {
    const Transfer result = write(kConfig, sleep_config_);
    asleep_ = result == Transfer::kDone;
    return result;
}

void Converter::recover() {
    hal_.clear_bus();
    write(kResetDevice, 0x8000);
    forget_config();
    sleep();
}

bool SwitchChain::send(const uint8_t* words, uint8_t count) {
    uint8_t before[kMostDevices] = {0};
    wired_back_ = hal_.shift(words, count, before);
    const bool same = !wired_back_ || memcmp(before, last_, count) == 0;
    memcpy(last_, words, count);
    return same;
}

bool SwitchChain::open_all(uint8_t count) {
    static const uint8_t kOpen[kMostDevices] = {0};
    return send(kOpen, count);
}

}  // namespace coilarray
