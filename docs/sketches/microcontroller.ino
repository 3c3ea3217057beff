// Sends two voltages and the counts of an HX711 with a load cell to a Tickwork Microcontroller block, at 200 Hz.
//
//     Microcontroller(fields=(("load", "int32"), ("analog", "uint16[2]", "V", 3.3 / 1023)), name="teensy")
//
// To send other quantities, change `Fields` and `measure`; the block's `fields` list the same fields in the same order.
// No packet is sent while the HX711 does not respond, so the block's `timeout` ends the run.

#include <Arduino.h>
#include "packet.h"

const int HX711_DATA = 2, HX711_CLOCK = 3;
const unsigned long PERIOD = 5000;              // µs
const unsigned long CONVERSION_LIMIT = 300000;  // µs

struct __attribute__((packed)) Fields {
    int32_t load;
    uint16_t analog[2];
};

Fields fields;
unsigned long due, converted = -CONVERSION_LIMIT;

// The data line of an HX711 is low after a conversion, at 10 or 80 Hz: 24 bits, highest first, and one more clock for
// gain 128. A clock that is high for 60 µs powers it down, so interrupts are disabled meanwhile.
bool read_hx711(int32_t *value) {
    if (digitalRead(HX711_DATA) == HIGH)
        return false;
    uint32_t bits = 0;
    for (int i = 0; i < 25; i++) {
        noInterrupts();
        digitalWrite(HX711_CLOCK, HIGH);
        delayMicroseconds(1);
        if (i < 24)
            bits = bits << 1 | (digitalRead(HX711_DATA) == HIGH);
        digitalWrite(HX711_CLOCK, LOW);
        interrupts();
        delayMicroseconds(1);
    }
    *value = bits & 0x800000 ? (int32_t)bits - 0x1000000 : (int32_t)bits;
    return true;
}

// Fill in `fields`. Returns whether they are valid.
bool measure() {
    int32_t load;
    if (read_hx711(&load)) {                    // otherwise the last conversion is still valid
        fields.load = load;
        converted = micros();
    }
    fields.analog[0] = analogRead(A0);
    fields.analog[1] = analogRead(A1);
    return micros() - converted < CONVERSION_LIMIT;
}

void setup() {
    Serial.begin(115200);                       // ignored by native USB ports
    pinMode(HX711_DATA, INPUT);
    pinMode(HX711_CLOCK, OUTPUT);
    digitalWrite(HX711_CLOCK, LOW);
    due = micros();
}

void loop() {
    if ((long)(micros() - due) < 0)
        return;
    due += PERIOD;
    if (measure())
        send(&fields, sizeof fields);
}
