// Sends typed fields to a Tickwork Microcontroller block, 200 times a second: a load cell behind an HX711, and two analogue inputs.
//
//     Microcontroller(fields=(("load", "int32"), ("analog", "uint16[2]", "V", 3.3 / 1023)), name="teensy")
//
// A packet is a counter, the fields one after another, least significant byte first, and CRC-16/CCITT-FALSE of both; stuffed by COBS, so that a
// zero ends it and is nowhere else. To send other things, change `Fields` and `measure`; the block's `fields` say the same, in the same order.

#include <Arduino.h>

const int HX711_DATA = 2, HX711_CLOCK = 3;
const unsigned long PERIOD = 5000;              // µs

struct __attribute__((packed)) Fields {
    int32_t load;
    uint16_t analog[2];
};

Fields fields;
uint8_t counter = 0;
unsigned long due;

// The HX711 has a new number when its data line is low, 10 or 80 times a second: 24 bits, highest first, and one more clock for gain 128.
// A clock that stays high for 60 µs would put it to sleep, so that nothing may interrupt one that does.
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

void measure() {
    int32_t load;
    if (read_hx711(&load))                      // else the last one again
        fields.load = load;
    fields.analog[0] = analogRead(A0);
    fields.analog[1] = analogRead(A1);
}

uint16_t checksum(const uint8_t *data, size_t count) {
    uint16_t crc = 0xFFFF;
    while (count--) {
        crc ^= (uint16_t)(*data++) << 8;
        for (int bit = 0; bit < 8; bit++)
            crc = crc & 0x8000 ? crc << 1 ^ 0x1021 : crc << 1;
    }
    return crc;
}

void send(const void *data, size_t count) {     // at most 250 bytes
    uint8_t plain[253], stuffed[256];
    plain[0] = counter++;
    memcpy(plain + 1, data, count);
    uint16_t crc = checksum(plain, count + 1);
    plain[count + 1] = crc & 0xFF;
    plain[count + 2] = crc >> 8;
    size_t code = 0, at = 1;                    // where the distance to the next zero goes, and the next byte
    for (size_t i = 0; i < count + 3; i++) {
        if (plain[i] != 0)
            stuffed[at++] = plain[i];
        else {
            stuffed[code] = at - code;
            code = at++;
        }
    }
    stuffed[code] = at - code;
    stuffed[at++] = 0;
    Serial.write(stuffed, at);                  // in one go
}

void setup() {
    Serial.begin(115200);                       // USB ports that are no adapters do not care
    pinMode(HX711_DATA, INPUT);
    pinMode(HX711_CLOCK, OUTPUT);
    digitalWrite(HX711_CLOCK, LOW);
    due = micros();
}

void loop() {
    if ((long)(micros() - due) < 0)
        return;
    due += PERIOD;
    measure();
    send(&fields, sizeof fields);
}
