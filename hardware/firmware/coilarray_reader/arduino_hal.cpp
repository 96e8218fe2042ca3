#include "arduino_hal.h"

#include <Arduino.h>

#include "board.h"

namespace coilarray {

static void pull_down(uint8_t pin) {
    digitalWrite(pin, LOW);
}

static void release(uint8_t pin) {
    digitalWrite(pin, HIGH);  // open drain: the pull-up does it
}

void ArduinoHal::begin() {
    pinMode(kDinPin, OUTPUT);
    pinMode(kSclkPin, OUTPUT);
    digitalWrite(kSclkPin, LOW);
    pinMode(kSyncPin, OUTPUT);
    digitalWrite(kSyncPin, HIGH);
    if (kDoutPin != kNoPin) {
        pinMode(kDoutPin, INPUT_PULLUP);
    }
    // A pin that becomes an output is low at first. The clock goes first, so that data never moves while it is high.
    pinMode(kSclPin, OUTPUT_OPENDRAIN);
    pull_down(kSclPin);
    pinMode(kSdaPin, OUTPUT_OPENDRAIN);
    release(kSdaPin);
    release(kSclPin);
}

// The core adds a counter of milliseconds to a timer: where it counts on between the two, the time is 1 ms ahead. Of
// two readings in a row at most one is.
uint32_t ArduinoHal::micros() {
    const uint32_t first = static_cast<uint32_t>(::micros());
    const uint32_t second = static_cast<uint32_t>(::micros());
    return elapsed(second, first) < kClockSlip ? second : first;
}

// ------------------------------------------------------------------------------------------------------- the converter

Transfer ArduinoHal::raise_clock() {
    release(kSclPin);
    const uint32_t since = micros();
    while (digitalRead(kSclPin) == LOW) {
        if (elapsed(micros(), since) > kBusGuard) {
            return Transfer::kTimeout;
        }
    }
    delayMicroseconds(kHalfClock);
    return Transfer::kDone;
}

Transfer ArduinoHal::start_condition() {
    release(kSdaPin);
    delayMicroseconds(kHalfClock);
    const Transfer clock = raise_clock();
    if (clock != Transfer::kDone) {
        return clock;
    }
    if (digitalRead(kSdaPin) == LOW) {
        return Transfer::kTimeout;  // somebody holds the bus
    }
    pull_down(kSdaPin);
    delayMicroseconds(kHalfClock);
    pull_down(kSclPin);
    return Transfer::kDone;
}

Transfer ArduinoHal::stop_condition() {
    pull_down(kSdaPin);
    delayMicroseconds(kHalfClock);
    const Transfer clock = raise_clock();
    release(kSdaPin);
    delayMicroseconds(kHalfClock);
    return clock;
}

Transfer ArduinoHal::write_byte(uint8_t byte) {
    for (uint8_t mask = 0x80; mask != 0; mask = static_cast<uint8_t>(mask >> 1)) {
        digitalWrite(kSdaPin, (byte & mask) != 0 ? HIGH : LOW);
        delayMicroseconds(kHalfClock);
        const Transfer clock = raise_clock();
        if (clock != Transfer::kDone) {
            return clock;
        }
        pull_down(kSclPin);
    }
    release(kSdaPin);
    delayMicroseconds(kHalfClock);
    const Transfer clock = raise_clock();
    if (clock != Transfer::kDone) {
        return clock;
    }
    const bool acknowledged = digitalRead(kSdaPin) == LOW;
    pull_down(kSclPin);
    return acknowledged ? Transfer::kDone : Transfer::kNotAcknowledged;
}

Transfer ArduinoHal::read_byte(uint8_t& byte, bool acknowledge) {
    byte = 0;
    release(kSdaPin);
    for (uint8_t i = 0; i < 8; ++i) {
        delayMicroseconds(kHalfClock);
        const Transfer clock = raise_clock();
        if (clock != Transfer::kDone) {
            return clock;
        }
        byte = static_cast<uint8_t>(byte << 1 | (digitalRead(kSdaPin) == LOW ? 0 : 1));
        pull_down(kSclPin);
    }
    digitalWrite(kSdaPin, acknowledge ? LOW : HIGH);
    delayMicroseconds(kHalfClock);
    const Transfer clock = raise_clock();
    pull_down(kSclPin);
    return clock;
}

Transfer ArduinoHal::end_transfer(Transfer result) {
    if (result == Transfer::kTimeout) {
        release(kSdaPin);
        release(kSclPin);
        return result;
    }
    const Transfer stop = stop_condition();
    return result == Transfer::kDone ? stop : result;
}

Transfer ArduinoHal::write_register(uint8_t address, uint16_t value) {
    const uint8_t bytes[] = {
        static_cast<uint8_t>(kConverterAddress << 1),
        address,
        static_cast<uint8_t>(value >> 8),
        static_cast<uint8_t>(value & 0xFF),
    };
    Transfer result = start_condition();
    for (uint8_t i = 0; i < sizeof(bytes) && result == Transfer::kDone; ++i) {
        result = write_byte(bytes[i]);
    }
    return end_transfer(result);
}

Transfer ArduinoHal::read_register(uint8_t address, uint16_t& value) {
    uint8_t high = 0, low = 0;
    Transfer result = start_condition();
    if (result == Transfer::kDone) {
        result = write_byte(static_cast<uint8_t>(kConverterAddress << 1));
    }
    if (result == Transfer::kDone) {
        result = write_byte(address);
    }
    if (result == Transfer::kDone) {
        result = start_condition();  // repeated
    }
    if (result == Transfer::kDone) {
        result = write_byte(static_cast<uint8_t>(kConverterAddress << 1 | 1));
    }
    if (result == Transfer::kDone) {
        result = read_byte(high, true);
    }
    if (result == Transfer::kDone) {
        result = read_byte(low, false);
    }
    value = static_cast<uint16_t>(high << 8 | low);
    return end_transfer(result);
}

void ArduinoHal::clear_bus() {
    release(kSdaPin);
    for (uint8_t i = 0; i < 9; ++i) {
        pull_down(kSclPin);
        delayMicroseconds(kHalfClock);
        release(kSclPin);
        delayMicroseconds(kHalfClock);
    }
    pull_down(kSclPin);
    stop_condition();
}

// -------------------------------------------------------------------------------------------------------- the switches

// SPI mode 1: the clock rests low, the devices take DIN at its falling edge and change DOUT at its rising edge. They
// switch when SYNC rises.
bool ArduinoHal::shift(const uint8_t* words, uint8_t count, uint8_t* before) {
    digitalWrite(kSyncPin, LOW);
    for (uint8_t i = 0; i < count; ++i) {
        uint8_t held = 0;
        for (uint8_t mask = 0x80; mask != 0; mask = static_cast<uint8_t>(mask >> 1)) {
            digitalWrite(kDinPin, (words[i] & mask) != 0 ? HIGH : LOW);
            digitalWrite(kSclkPin, HIGH);
            if (kDoutPin != kNoPin) {
                delayMicroseconds(1);  // DOUT rises through its pull-up
                held = static_cast<uint8_t>(held << 1 | (digitalRead(kDoutPin) == LOW ? 0 : 1));
            }
            digitalWrite(kSclkPin, LOW);
        }
        before[i] = held;
    }
    digitalWrite(kSyncPin, HIGH);
    return kDoutPin != kNoPin;
}

// ------------------------------------------------------------------------------------------------------------ the rest

int ArduinoHal::receive() {
    return Serial.read();
}

uint32_t ArduinoHal::send_wait() {
    return Serial.availableForWrite() > 0 ? 0 : 1;
}

void ArduinoHal::send(uint8_t byte) {
    Serial.write(byte);
}

// No clock and no memory outlasts a reset, so the number is made of the noise of an analog pin that nothing drives.
uint32_t ArduinoHal::boot_number() {
    uint32_t hash = 0x811C9DC5;  // FNV-1a
    for (uint8_t i = 0; i < 64; ++i) {
        hash = (hash ^ static_cast<uint32_t>(analogRead(A0))) * 0x01000193;
        hash = (hash ^ (micros() & 0xFF)) * 0x01000193;
    }
    return hash;
}

}  // namespace coilarray
