// Reads a coil array: an LDC1614 behind a chain of ADG739 switches, on an XMC 2Go. See ../README.md and ../PROTOCOL.md.

#include <Arduino.h>

#include "arduino_hal.h"
#include "board.h"
#include "reader.h"

static coilarray::ArduinoHal hal;
static coilarray::Reader reader(hal, coilarray::kDefaultSafeWords, coilarray::kDefaultDevices);

void setup() {
    hal.begin();
    reader.begin();  // first of all: coils grounded, converter asleep
    Serial.begin(coilarray::kBaud);
    delay(100);  // the debugger's port is not ready at once
}

void loop() {
    reader.poll();
}
