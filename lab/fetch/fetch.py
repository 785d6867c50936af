#!/usr/bin/env python3
"""Downloads sequences of the paper from their publishers and unpacks them.

    python3 lab/fetch/fetch.py --list
    python3 lab/fetch/fetch.py --out recordings V1_01_easy fr1_room

Needs Python 3.9 and a network, nothing else. A download that breaks off goes on where it ended when the script runs again. Of each
archive the size that the server names, the checksums inside, and the SHA-256 are checked: the SHA-256 of the first complete download is
kept in SHA256SUMS beside the archives (this script knows none beforehand), and later downloads must have the same. The room scan of EuRoC comes with
its sequences as mav0/pointcloud0/data.ply; TUM has no scan.

EuRoC archives hold all sequences of a room (several GB); sequences of one room share a download. Publishers move their files:
--url NAME=URL takes an archive from another place, also from a file (file:///...).
"""

import argparse
import hashlib
import os
import pathlib
import shutil
import sys
import tarfile
import urllib.error
import urllib.request
import zipfile

TUM = "https://cvg.cit.tum.de/rgbd/dataset/{0}/rgbd_dataset_{0}_{1}.tgz"
ETH = "https://www.research-collection.ethz.ch/server/api/core/bitstreams/{}/content"
ROOMS = {
    "machine_hall": ETH.format("7b2419c1-62b5-4714-b7f8-485e5fe3e5fe"),
    "vicon_room1": ETH.format("02ecda9a-298f-498b-970c-b7c44334d880"),
    "vicon_room2": ETH.format("ea12bc01-3677-4b4c-853d-87c7870b8c44"),
}
# Name: file of the archive, its address, folder of the unpacked sequence.
SEQUENCES = {
    "fr1_room": ("freiburg1", "room"),
    "fr3_large_cabinet": ("freiburg3", "large_cabinet"),
    "fr3_structure_texture_near": ("freiburg3", "structure_texture_near"),
    "V1_01_easy": ("vicon_room1",),
    "V2_01_easy": ("vicon_room2",),
    "MH_01_easy": ("machine_hall",),
}
CHUNK = 1 << 20


class Failure(Exception):
    """What the user has to know."""


def source(name):
    """File name, address and folder of a sequence."""
    parts = SEQUENCES[name]
    if len(parts) == 2:
        url = TUM.format(*parts)
        file = url.rsplit("/", 1)[1]
        return file, url, file[: -len(".tgz")]
    return parts[0] + ".zip", ROOMS[parts[0]], name


def open_from(url, start):
    """The response from a byte on, and whether the server kept to it."""
    request = urllib.request.Request(url, headers={"User-Agent": "linecarve-fetch"})
    if start:
        request.add_header("Range", f"bytes={start}-")
    try:
        response = urllib.request.urlopen(request, timeout=60)
    except urllib.error.HTTPError as error:
        if error.code == 416:
            raise Failure(f"{url}: nothing beyond byte {start}: remove the .part file and run again") from error
        raise Failure(
            f"{url}: the server answers {error.code} {error.reason}; if the file has moved, give --url NAME=URL"
        ) from error
    except (urllib.error.URLError, OSError, ValueError) as error:
        reason = getattr(error, "reason", error)
        raise Failure(f"{url}: no connection ({reason}); is there a network? Run again to go on") from error
    return response, getattr(response, "status", None) == 206


def download(url, path):
    """Downloads to `path`, through `path.part`."""
    part = path.with_name(path.name + ".part")
    start = part.stat().st_size if part.exists() else 0
    response, goes_on = open_from(url, start)
    with response:
        if start and not goes_on:
            print(f"{path.name}: the server cannot go on at byte {start}, from the start", file=sys.stderr)
            start = 0
        length = response.headers.get("Content-Length")
        total = start + int(length) if length else None
        if total and shutil.disk_usage(part.parent).free < total - start:
            raise Failure(f"{path.name}: {total - start} bytes are needed in {part.parent}, and there are fewer")
        done = start
        try:
            with open(part, "ab" if start else "wb") as file:
                while chunk := response.read(CHUNK):
                    file.write(chunk)
                    done += len(chunk)
                    if done % (256 * CHUNK) < CHUNK:
                        print(f"{path.name}: {done >> 20} of {(total or 0) >> 20} MB", file=sys.stderr)
        except OSError as error:
            raise Failure(f"{path.name}: broke off at byte {done} ({error}); run again to go on") from error
    if total is not None and done != total:
        raise Failure(f"{path.name}: {done} of {total} bytes arrived; run again to go on")
    os.replace(part, path)


def sha256(path):
    """The SHA-256 of a file."""
    found = hashlib.sha256()
    with open(path, "rb") as file:
        while chunk := file.read(CHUNK):
            found.update(chunk)
    return found.hexdigest()


def check(path, sums):
    """Compares a file with SHA256SUMS, or adds it there."""
    known = {}
    if sums.exists():
        for line in sums.read_text().splitlines():
            digest, _, name = line.partition("  ")
            known[name] = digest
    found = sha256(path)
    if path.name not in known:
        with open(sums, "a") as file:
            file.write(f"{found}  {path.name}\n")
    elif known[path.name] != found:
        raise Failure(
            f"{path.name}: SHA-256 {found}, but {sums} has {known[path.name]}; remove the file and run again, or remove "
            "its line if the publisher changed it"
        )


def safe(name):
    """Whether a member stays in the folder that it is unpacked to."""
    path = pathlib.PurePosixPath(name)
    return not path.is_absolute() and ".." not in path.parts


def unpack_zip(archive, target):
    """Unpacks a zip file; its checksums are verified on the way."""
    for member in archive.infolist():
        if not safe(member.filename):
            raise Failure(f"the archive holds {member.filename}, outside of its folder")
        if not member.filename.startswith("__MACOSX"):
            archive.extract(member, target)


def unpack(path, name, folder):
    """Unpacks one sequence to `folder`, through a folder beside it."""
    part = folder.with_name(folder.name + ".part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    try:
        if path.suffix == ".tgz":
            with tarfile.open(path) as archive:
                for member in archive:
                    if not safe(member.name) or not (member.isfile() or member.isdir()):
                        raise Failure(f"the archive holds {member.name}, which is no file in its folder")
                    archive.extract(member, part)
            inner = part / folder.name
        else:
            with zipfile.ZipFile(path) as archive:
                members = [m for m in archive.namelist() if m.rsplit("/", 1)[-1] == name + ".zip"]
                if members:
                    with archive.open(members[0]) as nested, zipfile.ZipFile(nested) as sequence:
                        unpack_zip(sequence, part)
                elif "mav0/" in " ".join(archive.namelist()):
                    unpack_zip(archive, part)
                else:
                    raise Failure(f"it holds no {name}.zip")
            inner = part
    except (tarfile.TarError, zipfile.BadZipFile, EOFError, OSError) as error:
        shutil.rmtree(part, ignore_errors=True)
        raise Failure(f"{path}: damaged ({error}); remove it and run again") from error
    except Failure as error:
        shutil.rmtree(part, ignore_errors=True)
        raise Failure(f"{path}: {error}") from error
    if not any((inner / file).exists() for file in ("mav0", "rgb.txt")):
        raise Failure(f"{path}: unpacked to {part}, but there is neither mav0 nor rgb.txt in it")
    os.replace(inner, folder)
    shutil.rmtree(part, ignore_errors=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sequences", nargs="*", metavar="NAME", help="sequences; default: all of --list")
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("recordings"), help="folder of the sequences")
    parser.add_argument("--url", action="append", default=[], metavar="NAME=URL", help="another place of an archive")
    parser.add_argument("--list", action="store_true", help="the sequences and their addresses")
    args = parser.parse_args()
    if args.list:
        for name in SEQUENCES:
            print(f"{name:28} {source(name)[1]}")
        return
    places = dict(place.partition("=")[::2] for place in args.url)
    for name in [*args.sequences, *places]:
        if name not in SEQUENCES:
            raise Failure(f"{name}: no sequence of that name; --list names them")
    archives = args.out / "archives"
    archives.mkdir(parents=True, exist_ok=True)
    for name in args.sequences or SEQUENCES:
        file, url, folder = source(name)
        target = args.out / folder
        if target.exists():
            print(f"{name}: {target} is there already")
            continue
        path = archives / file
        if not path.exists():
            download(places.get(name, url), path)
        check(path, archives / "SHA256SUMS")
        unpack(path, name, target)
        print(f"{name}: {target}")


if __name__ == "__main__":
    try:
        main()
    except Failure as failure:
        sys.exit(f"fetch.py: {failure}")
    except KeyboardInterrupt:
        sys.exit("fetch.py: stopped; run again to go on")
