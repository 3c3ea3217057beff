"""Serial streams and I2C buses, each read by a thread."""
