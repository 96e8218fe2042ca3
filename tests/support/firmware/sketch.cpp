// The whole sketch, pins included, as a library for the tests.

#include <stdint.h>

#include "coilarray_reader.ino"

extern "C" {

struct Pins {
    void (*mode)(uint8_t pin, uint8_t mode);
    void (*write)(uint8_t pin, uint8_t level);
    int (*read)(uint8_t pin);
    int (*analog)(uint8_t pin);
    double (*now)();
    void (*sleep)(double seconds);
    void (*open)(unsigned long baud);
    int (*receive)();
    void (*send)(uint8_t byte);
};

static Pins pins;
static double race = 0;  // seconds between reading the timer and the counter of milliseconds

void sketch_install(const Pins* given) { pins = *given; }
void sketch_race(double seconds) { race = seconds; }
void sketch_setup() { setup(); }
void sketch_loop(uint32_t times) {
    while (times-- > 0) {
        loop();
    }
}

}  // extern "C"

SerialPort Serial;

void pinMode(uint8_t pin, uint8_t mode) { pins.mode(pin, mode); }
void digitalWrite(uint8_t pin, uint8_t level) { pins.write(pin, level); }
int digitalRead(uint8_t pin) { return pins.read(pin); }
int analogRead(uint8_t pin) { return pins.analog(pin); }
// As the core of the XMC: where the counter goes on after the timer was read, the time is a millisecond ahead.
unsigned long micros() {
    const double read = pins.now();
    if (race > 0) {
        pins.sleep(race);
    }
    const uint64_t ticks = static_cast<uint64_t>(pins.now() * 1e3) - static_cast<uint64_t>(read * 1e3);
    return static_cast<uint32_t>(static_cast<uint64_t>(read * 1e6) + 1000 * ticks);
}
void delay(unsigned long milliseconds) { pins.sleep(static_cast<double>(milliseconds) * 1e-3); }
void delayMicroseconds(unsigned int microseconds) { pins.sleep(microseconds * 1e-6); }
void SerialPort::begin(unsigned long baud) { pins.open(baud); }
int SerialPort::read() { return pins.receive(); }
int SerialPort::availableForWrite() { return 1; }
size_t SerialPort::write(uint8_t byte) {
    pins.send(byte);
    return 1;
}
