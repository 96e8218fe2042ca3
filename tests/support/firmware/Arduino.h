// As much of Arduino's core as the sketch uses, for this computer: pins, time and the port are functions of the caller.
#pragma once

#include <stddef.h>
#include <stdint.h>

enum : uint8_t { LOW = 0, HIGH = 1 };
enum : uint8_t { INPUT = 0, OUTPUT = 1, INPUT_PULLUP = 2, OUTPUT_OPENDRAIN = 3 };
enum : uint8_t { A0 = 0 };

void pinMode(uint8_t pin, uint8_t mode);
void digitalWrite(uint8_t pin, uint8_t level);
int digitalRead(uint8_t pin);
int analogRead(uint8_t pin);
unsigned long micros();
void delay(unsigned long milliseconds);
void delayMicroseconds(unsigned int microseconds);

class SerialPort {
  public:
    void begin(unsigned long baud);
    int read();
    int availableForWrite();
    size_t write(uint8_t byte);
};

extern SerialPort Serial;
