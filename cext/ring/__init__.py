"""Lock-free rings and the mailbox in shared memory."""
