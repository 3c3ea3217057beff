// Packets of a Tickwork Microcontroller block: a counter, the fields in order, least significant byte first, and
// CRC-16/CCITT-FALSE of both; COBS-encoded, so a zero ends a packet and occurs nowhere else.

#include <Arduino.h>

static uint8_t counter = 0;

// Return the CRC-16/CCITT-FALSE of `count` bytes.
static uint16_t checksum(const uint8_t *data, size_t count) {
    uint16_t crc = 0xFFFF;
    while (count--) {
        crc ^= (uint16_t)(*data++) << 8;
        for (int bit = 0; bit < 8; bit++)
            crc = crc & 0x8000 ? crc << 1 ^ 0x1021 : crc << 1;
    }
    return crc;
}

// Send one packet with `count` bytes of fields, 250 at most.
static void send(const void *data, size_t count) {
    uint8_t plain[253], stuffed[256];
    plain[0] = counter++;
    memcpy(plain + 1, data, count);
    uint16_t crc = checksum(plain, count + 1);
    plain[count + 1] = crc & 0xFF;
    plain[count + 2] = crc >> 8;
    size_t code = 0, at = 1;                    // indices of the next distance to a zero, and of the next byte
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
    Serial.write(stuffed, at);
}
