#include "switching.h"

#include <string.h>

namespace coilarray {

constexpr uint8_t kTerminals = 64;
// Nets as bits: of code & 3 = 0, 1, 2, 3.
constexpr uint8_t kGroundNet = 1, kInaNet = 2, kInbNet = 4, kOtherNet = 8;
static const uint8_t kNetBits[] = {kGroundNet, kInaNet, kInbNet, kOtherNet};

struct Nets {
    uint8_t of[kTerminals];  // nets that a terminal is on, one bit each
    bool closes_unused;
};

static void find_nets(const ScanPlan& plan, const uint8_t* words, Nets& nets) {
    memset(&nets, 0, sizeof(nets));
    for (uint8_t device = 0; device < plan.devices; ++device) {
        for (uint8_t number = 0; number < kSwitches; ++number) {
            if ((words[device] >> number & 1) == 0) {
                continue;
            }
            const uint8_t code = plan.wiring[device][number];
            if (code == kUnusedSwitch) {
                nets.closes_unused = true;
            } else {
                nets.of[code >> 2] = static_cast<uint8_t>(nets.of[code >> 2] | kNetBits[code & 3]);
            }
        }
    }
}

static bool grounds_all(const ScanPlan& plan, const Nets& nets, Text& reason) {
    for (uint8_t device = 0; device < plan.devices; ++device) {
        for (uint8_t number = 0; number < kSwitches; ++number) {
            const uint8_t code = plan.wiring[device][number];
            if (code != kUnusedSwitch && nets.of[code >> 2] != kGroundNet) {
                reason.add("not just grounded is terminal ");
                reason.add_decimal(code >> 2);
                return false;
            }
        }
    }
    return true;
}

static bool one_net_each(const Nets& nets, Text& reason) {
    for (uint8_t terminal = 0; terminal < kTerminals; ++terminal) {
        const uint8_t on = nets.of[terminal];
        if ((on & (on - 1)) != 0) {
            reason.add("on two nets is terminal ");
            reason.add_decimal(terminal);
            return false;
        }
    }
    return true;
}

// The one terminal on a net: its number, kTerminals for none, or kTerminals + 1 for several.
static uint8_t only_terminal(const Nets& nets, uint8_t net) {
    uint8_t found = kTerminals;
    for (uint8_t terminal = 0; terminal < kTerminals; ++terminal) {
        if ((nets.of[terminal] & net) != 0) {
            found = found == kTerminals ? terminal : static_cast<uint8_t>(kTerminals + 1);
        }
    }
    return found;
}

static bool one_coil_measured(const Nets& nets, Text& reason) {
    const uint8_t ina = only_terminal(nets, kInaNet), inb = only_terminal(nets, kInbNet);
    if (ina > kTerminals || inb > kTerminals) {
        reason.add(ina > kTerminals ? "several terminals on INA" : "several terminals on INB");
        return false;
    }
    if ((ina == kTerminals) != (inb == kTerminals)) {
        reason.add("one of INA and INB has no terminal");
        return false;
    }
    if (ina >> 1 != inb >> 1) {
        reason.add("INA and INB have two coils");
        return false;
    }
    return true;
}

bool legal(const ScanPlan& plan, Text& reason) {
    Nets nets;
    reason.add("safe words: ");
    find_nets(plan, plan.safe, nets);
    if (nets.closes_unused) {
        reason.add("unused switch closed");
        return false;
    }
    if (!grounds_all(plan, nets, reason)) {
        return false;
    }
    for (uint8_t i = 0; i < plan.states; ++i) {
        reason.clear();
        reason.add("state ");
        reason.add_decimal(i);
        reason.add(": ");
        find_nets(plan, plan.state[i].words, nets);
        if (nets.closes_unused) {
            reason.add("unused switch closed");
            return false;
        }
        if (!one_net_each(nets, reason) || !one_coil_measured(nets, reason)) {
            return false;
        }
    }
    return true;
}

}  // namespace coilarray
