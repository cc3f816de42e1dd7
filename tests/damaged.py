"""Files with one byte changed."""


def damaged(path, bits=1):
    """Change a file byte by byte: all bits of each, and so many of them one by one; at the end it is as it was.

    In its place: to be written anew it would wait for the disk each time.
    """
    whole = path.read_bytes()
    with path.open("r+b", buffering=0) as file:
        for place, byte in enumerate(whole):
            for change in (0xFF, *(1 << (place + bit) % 8 for bit in range(bits)), 0):
                file.seek(place)
                file.write(bytes([byte ^ change]))
                if change:
                    yield
