// The board as the computer sees it: commands, replies, the stream with its lease, the heartbeat.
#pragma once

#include <stdint.h>

#include "chips.h"
#include "fields.h"
#include "hal.h"
#include "line_queue.h"
#include "line_receiver.h"
#include "scan_plan.h"
#include "scanner.h"
#include "text.h"

namespace coilarray {

enum class Error : uint8_t {
    kNone = 0,
    kUnknownVerb = 1,
    kBadArgument = 2,
    kOutOfOrder = 3,
    kIllegalSwitching = 4,
    kHashDiffers = 5,
    kBusFault = 6,
    kReadBackDiffers = 7,
    kOtherChip = 8,
    kBusy = 9,
};

class Reader {
  public:
    // `safe` grounds all coils of the board; `count` words.
    Reader(Hal& hal, const uint8_t* safe, uint8_t count);

    // Makes the chips safe. Before anything else.
    void begin();
    // Does what is due, in at most a few milliseconds (a COMMIT), usually far less. To be called over and over.
    void poll();
    // Microseconds in which poll() would have nothing to do unless a byte comes.
    uint32_t idle_time();
    // Whether a scan or a stream is under way, or a line is on its way out.
    bool busy() const { return streaming_ || scan_requested_ || ending_ != End::kNone || !queue_.empty(); }

  private:
    struct Command;
    enum class End : uint8_t { kNone = 0, kLease = 1, kConverterReset = 2, kBusFault = 3, kSwitchesDiffer = 4 };

    void send();
    void receive();
    void scan();
    void finish_scan();
    void keep_lease();
    void beat();

    void obey();
    void dispatch(Fields& fields);
    void answer(Error error);
    Error hello(Fields& fields);
    Error begin_draft(Fields& fields);
    Error wire(Fields& fields);
    Error safe(Fields& fields);
    Error set_register(Fields& fields);
    Error wait(Fields& fields);
    Error state(Fields& fields);
    Error commit(Fields& fields);
    Error scan_once(Fields& fields);
    Error start(Fields& fields);
    Error stop(Fields& fields);
    Error ping(Fields& fields);
    Error peek(Fields& fields);
    Error chain(Fields& fields);

    Error check_draft(uint32_t hash);
    Error check_identity();
    Error program();
    Error bus_fault(const char* text);
    // Ends whatever runs; grounds all coils and puts the converter to sleep. False where the converter does not answer.
    bool rest();
    void end_stream(End end);
    void forget_plan();
    bool active() const { return streaming_ || scan_requested_; }

    void emit(Text& line);
    void add_scan(Text& line, uint32_t sequence) const;
    char mode() const { return streaming_ ? 's' : configured_ ? 'i' : 'u'; }
    uint16_t hash() const { return configured_ ? hash_ : uint16_t{0}; }

    static constexpr uint32_t kLease = 10000000;     // microseconds
    static constexpr uint32_t kHeartbeat = 1000000;  // microseconds
    static constexpr uint8_t kBytesAtOnce = 64;
    static constexpr uint32_t kLongestTimeout = 60000000, kLongestInterval = 0x7FFFFFFF;  // microseconds

    Hal& hal_;
    Converter converter_;
    SwitchChain switches_;
    Scanner scanner_;
    LineReceiver receiver_;
    LineQueue queue_;

    ScanPlan plan_, draft_;
    uint16_t hash_ = 0;
    bool configured_ = false, drafting_ = false;
    uint8_t safe_[kMostDevices];  // words that ground all coils, as far as is known
    uint8_t safe_count_;

    bool streaming_ = false, scan_requested_ = false;
    End ending_ = End::kNone;  // a stream that ended and has not been told yet
    uint16_t ended_hash_ = 0;
    uint32_t sequence_ = 0, interval_ = 0, next_start_ = 0;
    uint32_t last_command_ = 0, last_line_ = 0;
    uint32_t boot_ = 0;

    uint8_t id_ = 0;  // of the last command
    uint16_t crc_ = 0;
    bool has_command_ = false, has_reply_ = false;
    uint8_t scan_id_ = 0;  // of the SCAN under way
    Text reply_;           // to the last command, kept for a repeat
    Text line_;            // any other line, while it is written
    Text why_;             // the reason of an error, while it is written
};

}  // namespace coilarray
