"""CAN buses: in memory, with timing, replayed, and SocketCAN."""
