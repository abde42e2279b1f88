#!/usr/bin/env bash
# Runs `capture.v4l` against the kernel's virtual cameras (vivid) in a small virtual machine, whatever the host's kernel is:
# two cameras, a damaged buffer, dropped frames, a broken stream, a disconnected camera and a pulled cable. About two minutes.
# Needs qemu-system-x86_64, busybox (static), cpio and a kernel package of Debian; `--install` gets them by apt. Without them it says so and passes.
# With FOVEATE_VIVID_OUT=DIR the console of the machine is kept there.
set -euo pipefail
cd "$(dirname "$0")/../.."
here=tests/vivid

skip() { echo "skipped: the test against virtual cameras needs $1"; exit 0; }

if [ "${1:-}" = --install ]; then
  (apt-get update -q && apt-get install -q -y --no-install-recommends qemu-system-x86 seabios busybox-static cpio) >/dev/null 2>&1 || true
fi
for tool in qemu-system-x86_64 busybox cpio; do
  command -v "$tool" >/dev/null || skip "$tool (apt install qemu-system-x86 busybox-static cpio)"
done

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# The kernel with its modules: an installed one, or a package that is only unpacked.
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
cargo build -q --locked -p foveate-cli --features hardware
cargo build -q --locked -p foveate-capture -p foveate-cli --features hardware --example press_control
target=${CARGO_TARGET_DIR:-target}/debug

echo "== making the machine"
root=$work/root
mkdir -p "$root"/{bin,proc,sys,dev,tmp,modules,rig}
cp "$(command -v busybox)" "$root/bin/busybox"
ln -s busybox "$root/bin/sh"
for program in "$target/foveate" "$target/examples/press_control"; do
  strip -o "$root/bin/$(basename "$program")" "$program" 2>/dev/null || cp "$program" "$root/bin/"
  ldd "$program" | grep -o '/[^ ]*' | while read -r library; do
    mkdir -p "$root$(dirname "$library")"
    cp -n "$library" "$root$library"
  done
done
modules="mc videodev videobuf2-common videobuf2-v4l2 videobuf2-memops videobuf2-vmalloc videobuf2-dma-contig v4l2-dv-timings v4l2-tpg rc-core cec vivid"
for module in $modules; do
  found=$(find "$kernel/lib/modules" -name "$module.ko*" | head -n 1)
  [ -n "$found" ] || skip "the kernel module $module"
  case "$found" in
    *.xz) xz -dc "$found" > "$root/modules/$module.ko" ;;
    *) cp "$found" "$root/modules/$module.ko" ;;
  esac
done
cp "$here/rig.toml" "$here/cameras.calibration.toml" "$root/rig/"
cp "$here/init" "$root/init"
(cd "$root" && find . | cpio -o -H newc --quiet | gzip -1) > "$work/root.gz"

echo "== running"
console=${FOVEATE_VIVID_OUT:-$work}/console.txt
timeout 540 qemu-system-x86_64 -machine q35 -accel tcg,thread=multi -cpu max -smp 2 -m 768 -kernel "$image" -initrd "$work/root.gz" \
  -append "console=ttyS0 quiet panic=-1" -nographic -no-reboot -nic none < /dev/null | tr -d '\r' > "$console" || true

python3 "$here/judge.py" "$console"
