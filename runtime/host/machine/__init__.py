"""The computer: processors, real-time set-up, CAN interfaces and ports."""
