// Toggles a pin for each message of a Tickwork ChargePump block that has another number than the last. The circuit behind the pin holds the
// motors' relay only while the pin changes, so the relay drops when messages end, and when this microcontroller hangs.
//
//     ChargePump(name="pump")          and in the rig file: [device.pump] port = "/dev/serial/by-id/..."
//
// A message is a counter (one byte) and its CRC-16/CCITT-FALSE, least significant byte first; stuffed by COBS, so that a zero ends it and is
// nowhere else: five bytes. After 50 ms without a message the pin is low and stays low.

#include <Arduino.h>

const int PUMP = 4;
const unsigned long SILENCE = 50000;            // µs

uint8_t message[4];                             // without the zero at its end
size_t count = 0;
int newest = -1;                                // number of the last message, -1: none
bool level = false;
unsigned long heard = 0;                        // µs

uint16_t checksum(uint8_t byte) {
    uint16_t crc = 0xFFFF ^ (uint16_t)byte << 8;
    for (int bit = 0; bit < 8; bit++)
        crc = crc & 0x8000 ? crc << 1 ^ 0x1021 : crc << 1;
    return crc;
}

// The number in the four bytes before a zero, or -1 where they are no message.
int number_in(const uint8_t *stuffed) {
    uint8_t plain[4];
    size_t at = 0, taken = 0;
    while (taken < 4) {
        size_t code = stuffed[taken];
        if (taken + code > 4)
            return -1;
        for (size_t i = 1; i < code; i++)
            plain[at++] = stuffed[taken + i];
        taken += code;
        if (taken < 4)
            plain[at++] = 0;
    }
    uint16_t crc = checksum(plain[0]);
    return at == 3 && plain[1] == (crc & 0xFF) && plain[2] == crc >> 8 ? plain[0] : -1;
}

void take(uint8_t byte) {
    if (byte != 0) {
        if (count < sizeof message)
            message[count] = byte;
        count++;
        return;
    }
    int number = count == sizeof message ? number_in(message) : -1;
    count = 0;
    if (number < 0 || number == newest)
        return;
    newest = number;
    heard = micros();
    level = !level;
    digitalWrite(PUMP, level ? HIGH : LOW);
}

void setup() {
    pinMode(PUMP, OUTPUT);
    digitalWrite(PUMP, LOW);
    Serial.begin(115200);                       // USB ports that are no adapters do not care
}

void loop() {
    while (Serial.available() > 0)
        take(Serial.read());
    if (level && micros() - heard > SILENCE) {
        level = false;
        digitalWrite(PUMP, LOW);
    }
}
