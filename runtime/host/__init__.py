"""What every part of the runtime uses: errors, processes, the machine, the terminal, running programs."""
