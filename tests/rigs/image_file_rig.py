"""Image files that no encoder writes."""

import struct
import zlib


def png_of_size(width: int, height: int) -> bytes:
    """A small PNG file whose header announces ``width`` x ``height`` pixels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    parts = (b"IHDR", header), (b"IDAT", zlib.compress(bytes(100))), (b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*part) for part in parts)


def turned_jpeg(jpeg: bytes, orientation: int, *, big_endian: bool = False) -> bytes:
    """``jpeg`` with an EXIF segment whose tag 0x0112 tells readers to turn its pixels."""
    mark = ">" if big_endian else "<"
    entry = struct.pack(f"{mark}HHIHH", 0x0112, 3, 1, orientation, 0)
    tiff = (b"MM" if big_endian else b"II") + struct.pack(f"{mark}HIH", 42, 8, 1) + entry + bytes(4)
    body = b"Exif\0\0" + tiff
    return jpeg[:2] + b"\xff\xe1" + (len(body) + 2).to_bytes(2, "big") + body + jpeg[2:]
