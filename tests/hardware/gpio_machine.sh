#!/bin/sh
# Usage: gpio_machine.sh FOLDER 'command'   (FOLDER: what gpio_kernel.sh has made)
# Runs a shell command on an emulated machine that has the driver gpio-sim, with the host's files (read-only), environment and working
# directory; prints its output and exits with its status. Writable in there: /run (TMPDIR, lost at the end).
# Emulated throughout: a KVM inside a virtual machine may be there and not work.
set -eu
folder=$1
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
{ export -p; echo "export TMPDIR=/run; cd '$PWD'"; printf '%s\n' "$2"; } >"$work/command"
status=0
qemu-system-x86_64 -accel tcg,thread=multi -cpu max -M pc -m 2G -smp 2 -nodefaults -no-reboot -display none -serial file:"$work/console" \
    -kernel "$folder/vmlinuz" -initrd "$folder/initramfs" -append "quiet console=ttyS0 rdinit=/init panic=-1 mitigations=off" \
    -virtfs local,path=/,mount_tag=host,security_model=none,readonly=on,multidevs=remap \
    -virtfs local,path="$work",mount_tag=work,security_model=none </dev/null &
trap "kill $!; wait $!" TERM INT
wait $! || status=$?
if [ -f "$work/status" ]; then
    cat "$work/output"
    exit "$(cat "$work/status")"
fi
echo "the machine has not run the command (qemu ended with $status):"
tail -30 "$work/console"
exit 1
