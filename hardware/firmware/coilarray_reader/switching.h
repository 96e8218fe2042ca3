// Which words the switches may ever get. The computer checks the same; the firmware does not believe it.
#pragma once

#include <stdint.h>

#include "scan_plan.h"
#include "text.h"

namespace coilarray {

// Whether the safe words ground every terminal and close nothing else, and every state is legal: no terminal on two
// nets, on INA and INB one terminal each or none, both of the same coil, no unused switch closed. Says in `reason` what
// is wrong.
bool legal(const ScanPlan& plan, Text& reason);

}  // namespace coilarray
