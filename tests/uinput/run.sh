#!/usr/bin/env bash
# Runs `laser_pointer.uinput` against the kernel's virtual input devices in a small virtual machine, whatever the host's kernel is. A minute.
# Needs the same as tests/vivid/run.sh; `--install` gets it by apt. Without it says so and passes. FOVEATE_VIVID_KERNEL names a folder where a kernel package of Debian is unpacked.
set -euo pipefail
cd "$(dirname "$0")/../.."

skip() { echo "skipped: the test against virtual input devices needs $1"; exit 0; }

if [ "${1:-}" = --install ]; then
  (apt-get update -q && apt-get install -q -y --no-install-recommends qemu-system-x86 seabios busybox-static cpio) >/dev/null 2>&1 || true
fi
for tool in qemu-system-x86_64 busybox cpio; do
  command -v "$tool" >/dev/null || skip "$tool (apt install qemu-system-x86 busybox-static cpio)"
done

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

kernel=${FOVEATE_VIVID_KERNEL:-}
if [ -z "$kernel" ]; then
  command -v apt-get >/dev/null || skip "a kernel package of Debian (FOVEATE_VIVID_KERNEL names a folder where one is unpacked)"
  package=$(apt-cache depends linux-image-amd64 2>/dev/null | sed -n 's/.*Depends: \(linux-image-[0-9][^ ]*\)$/\1/p' | head -n 1)
  [ -n "$package" ] || skip "the kernel package linux-image-amd64"
  (cd "$work" && apt-get download -q "$package" >/dev/null 2>&1) || skip "the kernel package $package"
  dpkg-deb -x "$work"/"$package"_*.deb "$work/kernel"
  kernel=$work/kernel
fi
image=$(find "$kernel/boot" -name 'vmlinuz-*' | sort | tail -n 1)
[ -n "$image" ] || skip "a kernel in $kernel/boot"

echo "== building"
# (The program beside it, so that libraries are those of the whole workspace.)
tests=$(cargo test -q --locked -p foveate-laser-pointer -p foveate-cli --lib --no-run --message-format=json \
  | sed -n 's/.*"executable":"\([^"]*foveate_laser_pointer[^"]*\)".*/\1/p' | tail -n 1)

echo "== making the machine"
root=$work/root
mkdir -p "$root"/{bin,proc,sys,dev,tmp,modules}
cp "$(command -v busybox)" "$root/bin/busybox"
ln -s busybox "$root/bin/sh"
strip -o "$root/bin/tests" "$tests" 2>/dev/null || cp "$tests" "$root/bin/tests"
ldd "$tests" | grep -o '/[^ ]*' | while read -r library; do
  mkdir -p "$root$(dirname "$library")"
  cp -n "$library" "$root$library"
done
for module in evdev uinput; do
  found=$(find "$kernel/lib/modules" -name "$module.ko*" | head -n 1)
  [ -n "$found" ] || skip "the kernel module $module"
  case "$found" in
    *.xz) xz -dc "$found" > "$root/modules/$module.ko" ;;
    *) cp "$found" "$root/modules/$module.ko" ;;
  esac
done
cat > "$root/init" <<'INIT'
#!/bin/busybox sh
export PATH=/bin
busybox mount -t proc proc /proc
busybox mount -t sysfs sys /sys
busybox mount -t devtmpfs dev /dev
busybox insmod /modules/evdev.ko
# Before the module there is no device: what is refused by name, and what goes on without it.
tests uinput::tests --test-threads 1
busybox insmod /modules/uinput.ko
FOVEATE_UINPUT=1 tests uinput::kernel_test --test-threads 1 --nocapture && echo "UINPUT passed"
busybox poweroff -f
INIT
chmod +x "$root/init"
(cd "$root" && find . | cpio -o -H newc --quiet | gzip -1) > "$work/root.gz"

echo "== running"
timeout 540 qemu-system-x86_64 -machine q35 -accel tcg,thread=multi -cpu max -smp 2 -m 768 -kernel "$image" -initrd "$work/root.gz" \
  -append "console=ttyS0 quiet panic=-1" -nographic -no-reboot -nic none < /dev/null | tr -d '\r' > "$work/console" || true
grep -aE '^test |panicked|^  |left:|right:|UINPUT|test result' "$work/console" || true
[ "$(grep -acE 'UINPUT (tries|passed)' "$work/console")" = 3 ] || { echo "failed: what the kernel gives out is not what was sent"; exit 1; }
