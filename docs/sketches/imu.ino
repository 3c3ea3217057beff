// Sends an inertial sensor, an MPU-6050 or one with the same registers, to a Tickwork Microcontroller block, at 100 Hz.
//
//     Microcontroller(
//         fields=(
//             ("t", "uint32", "s", 1e-6),
//             ("accel", "int16[3]", "m/s²", 9.80665 / 4096),
//             ("gyro", "int16[3]", "rad/s", math.radians(1 / 32.8)),
//         ),
//         clock="t",
//         packet_rate=100,
//         name="thigh",
//     )
//
// No packet is sent while the sensor does not respond, so the block's `timeout` ends the run.
// (InvenSense RM-MPU-6000A-00 4.2, also valid for MPU-6500, MPU-9250 and ICM-20602)

#include <Arduino.h>
#include <Wire.h>
#include "packet.h"

const uint8_t ADDRESS = 0x68;                   // 0x69 with AD0 high
const unsigned long PERIOD = 10000;             // µs

struct __attribute__((packed)) Fields {
    uint32_t t;
    int16_t accel[3], gyro[3];
};

Fields fields;
unsigned long due;

void write_register(uint8_t number, uint8_t value) {
    Wire.beginTransmission(ADDRESS);
    Wire.write(number);
    Wire.write(value);
    Wire.endTransmission();
}

void configure() {
    write_register(0x6B, 0x01);                 // PWR_MGMT_1: awake, clock of the gyroscope
    write_register(0x1A, 0x03);                 // CONFIG: low-pass of about 44 Hz
    write_register(0x1B, 0x10);                 // GYRO_CONFIG: ±1000 °/s, 32.8 counts per °/s
    write_register(0x1C, 0x10);                 // ACCEL_CONFIG: ±8 g, 4096 counts per g
}

int16_t read_int16() {                          // high byte first
    uint8_t high = Wire.read();
    return (int16_t)(high << 8 | (uint8_t)Wire.read());
}

// Fill in `fields`. Returns whether they are valid: a sensor that has lost its supply sleeps and reads zero.
bool measure() {
    fields.t = micros();
    Wire.beginTransmission(ADDRESS);
    Wire.write((uint8_t)0x3B);                  // ACCEL_XOUT_H, followed by temperature and GYRO_XOUT_H
    if (Wire.endTransmission(false) != 0 || Wire.requestFrom(ADDRESS, (uint8_t)14) != 14)
        return false;
    for (int axis = 0; axis < 3; axis++)
        fields.accel[axis] = read_int16();
    read_int16();
    for (int axis = 0; axis < 3; axis++)
        fields.gyro[axis] = read_int16();
    return fields.accel[0] != 0 || fields.accel[1] != 0 || fields.accel[2] != 0;
}

void setup() {
    Serial.begin(115200);                       // ignored by native USB ports
    Wire.begin();
    Wire.setClock(400000);
    configure();
    due = micros();
}

void loop() {
    if ((long)(micros() - due) < 0)
        return;
    due += PERIOD;
    if (measure())
        send(&fields, sizeof fields);
    else
        configure();
}
