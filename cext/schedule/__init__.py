"""Program of a schedule, its life cycle, the watchdog and the publisher."""
