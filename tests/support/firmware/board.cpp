// The firmware's logic as a library for the tests: its Hal calls functions of the caller, its port is two buffers.

#include <stdint.h>
#include <string.h>

#include "reader.h"

using namespace coilarray;

extern "C" {

struct Callbacks {
    double (*now)();
    void (*sleep)(double seconds);
    int (*read_register)(uint8_t address, uint16_t* value);  // as Transfer
    int (*write_register)(uint8_t address, uint16_t value);
    void (*clear_bus)();
    int (*shift)(const uint8_t* words, uint8_t count, uint8_t* before);  // 1: wired back
};

}  // extern "C"

namespace {

constexpr uint32_t kReceiveBuffer = 512;  // as on the XMC
constexpr uint32_t kSentBuffer = 1 << 16;

class HostHal final : public Hal {
  public:
    HostHal(const Callbacks& callbacks, uint32_t boot, double byte_time)
        : callbacks_(callbacks), boot_(boot), byte_time_(byte_time) {
        refresh();
    }

    uint32_t micros() override { return static_cast<uint32_t>(static_cast<uint64_t>(now_ * 1e6 + 0.5)); }

    Transfer read_register(uint8_t address, uint16_t& value) override {
        const int result = callbacks_.read_register(address, &value);
        refresh();
        return static_cast<Transfer>(result);
    }

    Transfer write_register(uint8_t address, uint16_t value) override {
        const int result = callbacks_.write_register(address, value);
        refresh();
        return static_cast<Transfer>(result);
    }

    void clear_bus() override {
        callbacks_.clear_bus();
        refresh();
    }

    bool shift(const uint8_t* words, uint8_t count, uint8_t* before) override {
        const bool back = callbacks_.shift(words, count, before) != 0;
        refresh();
        return back;
    }

    int receive() override {
        if (received_ == 0) {
            return -1;
        }
        const uint8_t byte = in_[first_];
        first_ = (first_ + 1) % kReceiveBuffer;
        --received_;
        return byte;
    }

    uint32_t send_wait() override {
        return free_at_ <= now_ ? 0 : static_cast<uint32_t>((free_at_ - now_) * 1e6) + 1;
    }

    void send(uint8_t byte) override {
        if (sent_ < kSentBuffer) {
            out_[sent_++] = byte;
        }
        line_ended_ = line_ended_ || byte == '\n';
        free_at_ = now_ + byte_time_;
    }

    uint32_t boot_number() override { return boot_; }

    double now() const { return now_; }
    void refresh() { now_ = callbacks_.now(); }

    void sleep(double seconds) {
        callbacks_.sleep(seconds);
        refresh();
    }

    uint32_t feed(const uint8_t* bytes, uint32_t count) {
        uint32_t taken = 0;
        for (; taken < count && received_ < kReceiveBuffer; ++taken) {
            in_[(first_ + received_++) % kReceiveBuffer] = bytes[taken];
        }
        return taken;
    }

    uint32_t take_sent(uint8_t* into) {
        memcpy(into, out_, sent_);
        const uint32_t count = sent_;
        sent_ = 0;
        line_ended_ = false;
        return count;
    }

    uint32_t received() const { return received_; }
    bool line_ended() const { return line_ended_; }
    bool nearly_full() const { return sent_ > kSentBuffer / 2; }

  private:
    Callbacks callbacks_;
    uint32_t boot_;
    double byte_time_, now_ = 0, free_at_ = 0;
    uint8_t in_[kReceiveBuffer], out_[kSentBuffer];
    uint32_t first_ = 0, received_ = 0, sent_ = 0;
    bool line_ended_ = false;
};

struct Board {
    Board(const Callbacks& callbacks, const uint8_t* safe, uint8_t count, uint32_t boot, double byte_time)
        : hal(callbacks, boot, byte_time), reader(hal, safe, count) {}

    HostHal hal;
    Reader reader;
};

}  // namespace

extern "C" {

void* board_start(const Callbacks* callbacks, const uint8_t* safe, uint8_t count, uint32_t boot, double byte_time) {
    Board* board = new Board(*callbacks, safe, count, boot, byte_time);
    board->reader.begin();
    return board;
}

void board_free(void* handle) { delete static_cast<Board*>(handle); }

uint32_t board_feed(void* handle, const uint8_t* bytes, uint32_t count) {
    return static_cast<Board*>(handle)->hal.feed(bytes, count);
}

uint32_t board_take_sent(void* handle, uint8_t* into) { return static_cast<Board*>(handle)->hal.take_sent(into); }

// Runs until nothing is due within `seconds` from the start; or, where wanted, until a line has been sent. Returns the
// seconds until something is due, 0 where more may be done at once.
double board_run(void* handle, double seconds, int stop_at_line) {
    Board& board = *static_cast<Board*>(handle);
    board.hal.refresh();
    const double end = board.hal.now() + seconds;
    for (;;) {
        const uint32_t received = board.hal.received();
        board.reader.poll();
        if ((stop_at_line && board.hal.line_ended()) || board.hal.nearly_full()) {
            return 0;
        }
        const double idle = board.reader.idle_time() * 1e-6;
        if (idle <= 0 || board.hal.received() != received) {
            continue;
        }
        if (board.hal.now() + idle > end) {
            return idle;
        }
        board.hal.sleep(idle);
    }
}

int board_busy(void* handle) { return static_cast<Board*>(handle)->reader.busy(); }

uint32_t board_size() { return sizeof(Reader); }

}  // extern "C"
