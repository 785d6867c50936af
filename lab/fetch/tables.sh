#!/bin/sh
# All tables and figures of a folder of recordings.
#
#     lab/fetch/tables.sh RECORDINGS OUT [OPTION...]
#
# For each folder in RECORDINGS: OUT/NAME.txt with the tables, OUT/NAME/figure.png. The ground truth is the first of
# ground-truth-observed.ply, ground-truth.ply, mav0/pointcloud0/data.ply (a scan, aligned by its points), the points of
# colmap/ (a sparse model of the same images, which is no independent truth). Folders with none of them get the figure alone.
# Options go to `tables` and `figure`; LINECARVE_LAB names the program, else cargo builds it.
set -eu
if [ $# -lt 2 ]; then
    echo "usage: $0 RECORDINGS OUT [OPTION...]" >&2
    exit 2
fi
recordings=$1
out=$2
shift 2
if [ ! -d "$recordings" ]; then
    echo "$0: $recordings is no folder" >&2
    exit 2
fi
lab() {
    if [ -n "${LINECARVE_LAB:-}" ]; then
        "$LINECARVE_LAB" "$@"
    else
        cargo run --quiet --release -p linecarve-lab -- "$@"
    fi
}
mkdir -p "$out"
failed=0
for folder in "$recordings"/*/; do
    folder=${folder%/}
    name=$(basename "$folder")
    # Downloaded archives, and downloads under way.
    case $name in archives | *.part) continue ;; esac
    truth=
    for file in ground-truth-observed.ply ground-truth.ply mav0/pointcloud0/data.ply colmap/points3D.txt colmap/points3D.bin; do
        if [ -z "$truth" ] && [ -f "$folder/$file" ]; then
            truth=$file
        fi
    done
    echo "$name: ground truth ${truth:-none, no tables}" >&2
    align=none
    case $truth in mav0/*) align=se3 ;; esac
    if [ -n "$truth" ]; then
        # Under another name until it is whole.
        if lab tables "$folder" --ground-truth "$folder/$truth" --align $align --surfaces "$@" >"$out/$name.part"; then
            mv "$out/$name.part" "$out/$name.txt"
        else
            echo "$name: no tables, see above" >&2
            rm -f "$out/$name.part"
            failed=1
        fi
    fi
    if ! lab figure "$folder" --out "$out/$name" "$@"; then
        echo "$name: no figure, see above" >&2
        failed=1
    fi
done
exit $failed
