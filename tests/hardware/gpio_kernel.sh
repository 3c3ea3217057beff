#!/bin/sh
# Usage: gpio_kernel.sh [FOLDER]   (as root, on Debian for x86-64; default: ~/.cache/tickwork/gpio-kernel)
# A kernel with simulated GPIO lines for gpio_machine.sh: Debian's own, and the driver gpio-sim, which its configuration leaves out, built from
# its own source as a module. Downloads about 220 MB, keeps 12.
set -eu
folder=${1:-$HOME/.cache/tickwork/gpio-kernel}
apt-get install -y --no-install-recommends qemu-system-x86 busybox-static cpio kmod make xz-utils linux-headers-amd64
kernel=$(ls -d /usr/src/linux-headers-*-amd64 | sort -V | tail -1 | sed s,.*/linux-headers-,,)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
chmod 755 "$work"
cd "$work"
apt-get download "linux-image-$kernel" "linux-source-$(echo "$kernel" | cut -d. -f1,2)"
dpkg-deb -x linux-image-*.deb image
dpkg-deb --fsys-tarfile linux-source-*.deb | tar -xO --wildcards '*.tar.xz' |
    tar -xJ --strip-components=1 --wildcards '*/drivers/gpio/gpio-sim.c' '*/drivers/gpio/gpiolib.h' '*/kernel/irq/irq_sim.c'
mkdir module
cp drivers/gpio/gpio-sim.c drivers/gpio/gpiolib.h kernel/irq/irq_sim.c module
sed -i 's/irq_to_desc(\([a-z]*\))/irq_data_to_desc(irq_get_irq_data(\1))/' module/irq_sim.c     # the one that modules may call
printf 'obj-m := gpio-simulated.o\ngpio-simulated-y := gpio-sim.o irq_sim.o\n' >module/Makefile
make -C "/lib/modules/$kernel/build" M="$work/module" modules
mkdir -p initramfs/modules
depmod -b image "$kernel"
number=10
for module in $(modprobe -d "$work/image" -S "$kernel" --show-depends virtio_pci | sed 's/insmod //') \
              $(for name in 9pnet_virtio 9p configfs; do modprobe -d "$work/image" -S "$kernel" --show-depends $name | sed 's/insmod //'; done) \
              module/gpio-simulated.ko; do
    name=$(basename "$module")
    ls initramfs/modules | grep -q "^[0-9]*-$name\$" || cp "$module" "initramfs/modules/$number-$name"
    number=$((number + 1))
done
cp /bin/busybox initramfs/
cat >initramfs/init <<'END_OF_INIT'
#!/busybox sh
/busybox mkdir -p /bin /dev /proc /host
/busybox --install -s /bin
mount -t proc proc /proc
mount -t devtmpfs devtmpfs /dev
for module in /modules/*; do insmod "$module"; done
mount -t 9p -o trans=virtio,version=9p2000.L,ro,cache=loose,msize=262144 host /host
mount -t proc proc /host/proc
mount -t sysfs sysfs /host/sys
mount -t configfs configfs /host/sys/kernel/config
mount -t devtmpfs devtmpfs /host/dev
mkdir -p /host/dev/shm /host/dev/pts
mount -t tmpfs tmpfs /host/dev/shm
mount -t devpts devpts /host/dev/pts
mount -t tmpfs tmpfs /host/run
mkdir /host/run/job
mount -t 9p -o trans=virtio,version=9p2000.L,msize=262144 work /host/run/job
ifconfig lo up
chroot /host sh /run/job/command </dev/null >/host/run/job/output 2>&1
echo $? >/host/run/job/status
sync
poweroff -f
END_OF_INIT
chmod +x initramfs/init
mkdir -p "$folder"
(cd initramfs && find . | cpio -o -H newc) | gzip >"$folder/initramfs"
cp "image/boot/vmlinuz-$kernel" "$folder/vmlinuz"
