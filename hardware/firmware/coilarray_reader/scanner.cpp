#include "scanner.h"

#include <string.h>

namespace coilarray {

void Scanner::start(const ScanPlan& plan, uint32_t now) {
    plan_ = &plan;
    started_ = now;
    index_ = 0;
    memset(samples_, 0, sizeof(samples_));
    outcome_ = Outcome::kGood;
    phase_ = Phase::kSleepFirst;
}

void Scanner::forget_failures() {
    memset(bus_failures_, 0, sizeof(bus_failures_));
    memset(switch_failures_, 0, sizeof(switch_failures_));
}

void Scanner::step() {
    const State& state = plan_->state[index_];
    Sample& sample = samples_[index_];
    switch (phase_) {
        case Phase::kSleepFirst:  // switches move only while the converter sleeps
            if (!converter_.asleep()) {
                const Transfer result = converter_.sleep();
                if (result != Transfer::kDone) {
                    fail(static_cast<Fault>(result));
                    phase_ = Phase::kGround;
                    break;
                }
            }
            phase_ = Phase::kOpen;
            break;
        case Phase::kOpen:
            switched(switches_.open_all(plan_->devices), Phase::kSelect);
            break;
        case Phase::kSelect:
            switched(switches_.send(state.words, plan_->devices), Phase::kDrive);
            break;
        case Phase::kDrive:
            proceed(converter_.write(kDriveCurrent, state.drive), Phase::kWake);
            break;
        case Phase::kWake:
            proceed(converter_.wake(), Phase::kLook);
            woken_ = hal_.micros();
            next_look_ = plan_->wait;
            discarded_ = 0;
            break;
        case Phase::kLook:
            look();
            break;
        case Phase::kMsb:
            take_or_discard();
            break;
        case Phase::kLsb:
            proceed(converter_.read(kDataLsb, sample.lsb), plan_->own_drive() ? Phase::kOwnDrive : Phase::kSleep);
            break;
        case Phase::kOwnDrive:  // sleep may clear it
            proceed(converter_.read(kDriveCurrent, sample.drive), Phase::kSleep);
            break;
        case Phase::kSleep:
            proceed(converter_.sleep(), Phase::kGround);
            phase_ = Phase::kGround;
            break;
        case Phase::kGround:
            if (!switches_.send(plan_->safe, plan_->devices)) {
                fail(Fault::kSwitchesDiffer);
            }
            next_state();
            break;
        case Phase::kVerify:
            verify();
            break;
        case Phase::kIdle:
        case Phase::kDone:
            break;
    }
}

void Scanner::look() {
    const uint32_t since = elapsed(hal_.micros(), woken_);
    if (since < next_look_) {
        return;
    }
    Sample& sample = samples_[index_];
    uint16_t status = 0;
    const Transfer result = converter_.read(kStatus, status);
    sample.status |= status;  // reading clears the errors, so those of an earlier look are kept
    if (result != Transfer::kDone) {
        proceed(result, Phase::kSleep);
    } else if ((status & kDataReady) != 0) {
        phase_ = Phase::kMsb;
    } else if (since >= plan_->timeout) {
        fail(Fault::kNoResult);
        phase_ = Phase::kSleep;
    } else {
        const uint32_t again = since + kLookAgain;
        next_look_ = again < plan_->timeout ? again : plan_->timeout;
    }
}

// Reads the upper half of a result, which latches the lower one and clears the flags.
void Scanner::take_or_discard() {
    Sample& sample = samples_[index_];
    const bool last = discarded_ == plan_->discard;
    proceed(converter_.read(kDataMsb, sample.msb), last ? Phase::kLsb : Phase::kLook);
    if (!last) {
        ++discarded_;
        sample.status = 0;
        woken_ = hal_.micros();
        next_look_ = plan_->again;
    }
}

void Scanner::next_state() {
    ++index_;
    phase_ = Phase::kSleepFirst;
    if (index_ == plan_->states) {
        index_ = 0;
        phase_ = Phase::kVerify;
        register_ = met_bus_fault() ? 0 : kDividersIndex;
    }
}

void Scanner::verify() {
    uint16_t found = 0;
    const Transfer result = converter_.read(kRegisterAddresses[register_], found);
    const uint16_t differing = static_cast<uint16_t>(found ^ plan_->registers[register_]);
    const bool reset = result == Transfer::kDone && (register_ == kConfigIndex ? differing & ~kAsleep : differing) != 0;
    if (result == Transfer::kDone && !reset && met_bus_fault() && ++register_ < kRegisters) {
        return;  // a transfer that was cut off may have changed any of them
    }
    for (index_ = 0; index_ < plan_->states; ++index_) {
        if (reset) {
            samples_[index_].fault = Fault::kConverterReset;
        } else if (result != Transfer::kDone) {
            fail(static_cast<Fault>(result));  // a scan that cannot be verified is no measurement
        }
    }
    index_ = 0;
    judge();
    if (reset) {
        outcome_ = Outcome::kConverterReset;
    }
    phase_ = Phase::kDone;
}

bool Scanner::met_bus_fault() const {
    for (uint8_t i = 0; i < plan_->states; ++i) {
        if (samples_[i].fault == Fault::kNotAcknowledged || samples_[i].fault == Fault::kBusTimeout) {
            return true;
        }
    }
    return false;
}

void Scanner::judge() {
    for (uint8_t i = 0; i < plan_->states; ++i) {
        const Fault fault = samples_[i].fault;
        const bool bus = fault == Fault::kNotAcknowledged || fault == Fault::kBusTimeout;
        bus_failures_[i] = bus ? static_cast<uint8_t>(bus_failures_[i] + 1) : uint8_t{0};
        const bool chain = fault == Fault::kSwitchesDiffer;
        switch_failures_[i] = chain ? static_cast<uint8_t>(switch_failures_[i] + 1) : uint8_t{0};
        if (bus_failures_[i] >= kFailures) {
            outcome_ = Outcome::kBusFault;
        } else if (switch_failures_[i] >= kFailures && outcome_ == Outcome::kGood) {
            outcome_ = Outcome::kSwitchesDiffer;
        }
    }
}

void Scanner::proceed(Transfer result, Phase next) {
    if (result == Transfer::kDone) {
        phase_ = next;
        return;
    }
    fail(static_cast<Fault>(result));
    phase_ = Phase::kSleep;
}

void Scanner::switched(bool same, Phase next) {
    phase_ = next;
    if (!same) {
        fail(Fault::kSwitchesDiffer);
        phase_ = Phase::kGround;
    }
}

void Scanner::fail(Fault fault) {
    Sample& sample = samples_[index_];
    if (sample.fault == Fault::kNone) {
        sample.fault = fault;
    }
}

uint32_t Scanner::idle_time(uint32_t now) const {
    if (phase_ != Phase::kLook) {
        return 0;
    }
    const uint32_t since = elapsed(now, woken_);
    return since < next_look_ ? next_look_ - since : 0;
}

}  // namespace coilarray
