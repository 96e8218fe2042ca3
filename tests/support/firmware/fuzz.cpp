// The logic on chips that fail at random, fed from standard input; to be built with the sanitizers. Prints how many
// lines it sent, and fails where the switches move while the converter is awake although it could be put to sleep.

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "reader.h"

using namespace coilarray;

namespace {

[[noreturn]] void fail(const char* what) {
    fprintf(stderr, "%s\n", what);
    exit(1);
}

class FuzzHal final : public Hal {
  public:
    uint32_t micros() override { return time += 20; }

    Transfer read_register(uint8_t address, uint16_t& value) override {
        time += 120;
        if (chance(faults)) {
            return chance(2) ? Transfer::kTimeout : Transfer::kNotAcknowledged;
        }
        if (address == 0x18) {
            value = chance(8) ? 0 : static_cast<uint16_t>(0x48 | (chance(4) ? random() & 0x3F00 : 0));
        } else if (address == 0x7E || address == 0x7F) {
            value = address == 0x7E ? 0x5449 : 0x3055;
        } else {
            value = registers[address];
        }
        return Transfer::kDone;
    }

    Transfer write_register(uint8_t address, uint16_t value) override {
        time += 120;
        failed = chance(faults);
        if (failed) {
            return Transfer::kNotAcknowledged;
        }
        if (address == 0x1C) {
            memset(registers, 0, sizeof(registers));
            registers[0x1A] = 0x2801;
        } else {
            registers[address] = value;
        }
        return Transfer::kDone;
    }

    void clear_bus() override {}

    bool shift(const uint8_t* words, uint8_t count, uint8_t* before) override {
        if ((registers[0x1A] & 0x2000) == 0 && !failed) {
            fail("switches moved while the converter was awake");
        }
        memcpy(before, chain, count);
        memcpy(chain, words, count);
        if (chance(faults)) {
            before[0] = static_cast<uint8_t>(before[0] ^ 1);
        }
        return true;
    }

    int receive() override { return chance(3) ? getchar() : -1; }
    uint32_t send_wait() override { return chance(2) ? 100 : 0; }
    void send(uint8_t byte) override { lines += byte == '\n'; }
    uint32_t boot_number() override { return 0x12345678; }

    uint32_t random() {
        state = state * 1664525u + 1013904223u;
        return state >> 8;
    }
    bool chance(uint32_t one_in) { return one_in != 0 && random() % one_in == 0; }

    uint32_t time = 0xFFF00000, state = 1, lines = 0, faults = 0;
    uint16_t registers[256] = {0};
    uint8_t chain[kMostDevices] = {0};
    bool failed = false;
};

FuzzHal hal;  // static, as on the board: the sanitizer guards its ends
const uint8_t safe[6] = {0x11, 0x11, 0x11, 0x11, 0x11, 0x11};
Reader reader(hal, safe, 6);

}  // namespace

int main(int argc, char** argv) {
    hal.faults = argc > 1 ? static_cast<uint32_t>(atoi(argv[1])) : 0;
    hal.registers[0x1A] = 0x2801;
    reader.begin();
    while (!feof(stdin)) {
        reader.poll();
        hal.time += reader.idle_time() > 1000000 ? 1000000 : reader.idle_time();
    }
    for (int i = 0; i < 100000; ++i) {
        reader.poll();
    }
    printf("%u\n", hal.lines);
    return 0;
}
