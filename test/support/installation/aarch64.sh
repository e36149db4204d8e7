#!/bin/sh
# Build the package on an emulated 64-bit ARM, as of a Raspberry Pi or a Jetson, and run tests of the core there.
#
#     sudo sh test/support/installation/aarch64.sh FOLDER [TEST ...]
#
# FOLDER gets Debian 12 for arm64 (1 GB, once), and the last commit of this clone. Needs Debian or Ubuntu, and
#
#     sudo apt install debootstrap qemu-user-static
#
# TEST: arguments of pytest; without any, the lasso's tests, and the compiled kernel is compared with Python.
set -eu
here=$(cd "$(dirname "$0")/../../.." && pwd)
folder=${1:?usage: sudo sh $0 FOLDER [TEST ...]}
shift
[ $# -gt 0 ] || set -- test/core/test_kernel.py test/core/lasso/test_lasso.py -k "(same_answers and default) or test_lasso"

if [ ! -x "$folder/usr/bin/gcc" ]; then
    debootstrap --arch=arm64 --variant=minbase \
        --include=python3-venv,python3-dev,gcc,libc6-dev,ca-certificates bookworm "$folder"
fi
if ! chroot "$folder" /bin/true; then
    echo "programs for arm64 do not start here: run 'systemctl restart systemd-binfmt', or install qemu-user-static" >&2
    exit 1
fi
cp /etc/resolv.conf "$folder/etc/resolv.conf"
cp /etc/ssl/certs/ca-certificates.crt "$folder/etc/ssl/certs/"  # those of a proxy may be among them
rm -rf "$folder/src"
mkdir "$folder/src"
git -C "$here" -c safe.directory="$here" archive HEAD | tar -x -C "$folder/src"

chroot "$folder" sh -eux -s -- "$@" <<'EOF'
cd /src
[ -x /venv/bin/pip ] || python3 -m venv /venv
/venv/bin/pip install --quiet --editable . pytest hypothesis clarabel daqp quadprog
export OMP_NUM_THREADS=1
/venv/bin/python - <<'END'
import platform
from lassokin_ros.core.kernel import kernel
print(platform.machine(), "compiled kernel:", kernel.active)
raise SystemExit(not kernel.active)
END
/venv/bin/python -m pytest -p no:cacheprovider -o faulthandler_timeout=0 "$@"  # a test may take an hour here
EOF
