// One scan: every state once, as a machine of small steps that never waits.
#pragma once

#include <stdint.h>

#include "chips.h"
#include "scan_plan.h"

namespace coilarray {

enum class Fault : uint8_t {
    kNone = 0,
    kNotAcknowledged = 1,
    kBusTimeout = 2,
    kNoResult = 3,
    kConverterReset = 4,
    kSwitchesDiffer = 5,
};

struct Sample {
    uint16_t msb, lsb, status, drive;
    Fault fault;
};

// What a scan says about the board.
enum class Outcome : uint8_t { kGood, kConverterReset, kBusFault, kSwitchesDiffer };

class Scanner {
  public:
    Scanner(Hal& hal, Converter& converter, SwitchChain& switches)
        : hal_(hal), converter_(converter), switches_(switches) {}

    // `plan` must stay as it is until the scan has ended.
    void start(const ScanPlan& plan, uint32_t now);
    // At most one transfer on a bus. Only while running.
    void step();
    bool running() const { return phase_ != Phase::kIdle && phase_ != Phase::kDone; }
    bool done() const { return phase_ == Phase::kDone; }
    // Takes the scan: the scanner is idle again, its samples are kept until the next start.
    void take() { phase_ = Phase::kIdle; }
    // Ends a scan in the middle; leaves the chips to the caller.
    void abandon() { phase_ = Phase::kIdle; }
    // Forgets how often a state failed.
    void forget_failures();

    uint32_t started() const { return started_; }
    const Sample& sample(uint8_t index) const { return samples_[index]; }
    Outcome outcome() const { return outcome_; }
    // Microseconds in which step() would have nothing to do.
    uint32_t idle_time(uint32_t now) const;

  private:
    enum class Phase : uint8_t {
        kIdle, kSleepFirst, kOpen, kSelect, kDrive, kWake, kLook, kMsb, kLsb, kOwnDrive, kSleep, kGround, kVerify, kDone,
    };

    void look();
    void take_or_discard();
    void next_state();
    void verify();
    bool met_bus_fault() const;
    void judge();
    // Goes on to the next phase, or, where the transfer failed, to the end of the state.
    void proceed(Transfer result, Phase next);
    void switched(bool same, Phase next);
    void fail(Fault fault);

    static constexpr uint32_t kLookAgain = 1000;  // microseconds
    static constexpr uint8_t kFailures = 3;       // scans running in which a state fails

    Hal& hal_;
    Converter& converter_;
    SwitchChain& switches_;
    const ScanPlan* plan_ = nullptr;
    Phase phase_ = Phase::kIdle;
    Outcome outcome_ = Outcome::kGood;
    uint8_t index_ = 0;
    uint8_t register_ = 0;  // of the plan, that is verified next
    uint32_t started_ = 0, woken_ = 0;
    uint32_t next_look_ = 0;  // microseconds after waking, or after the last conversion that was thrown away
    uint8_t discarded_ = 0;   // conversions of this state
    Sample samples_[kMostStates];
    uint8_t bus_failures_[kMostStates] = {0};
    uint8_t switch_failures_[kMostStates] = {0};
};

}  // namespace coilarray
