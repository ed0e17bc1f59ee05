# SPDX-License-Identifier: GPL-3.0-or-later
"""Write a film as a small moving picture for pages that show no videos: an animated WebP.

    python headless/pictures/moving_picture.py docs/street.mp4 docs/street.webp

`make film` runs it.
"""

import argparse
import sys
from pathlib import Path

import cv2


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="moving_picture.py", description="Write a film as an animated WebP.")
    parser.add_argument("film", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--width", type=int, default=480, help="of the picture, in pixels")
    parser.add_argument("--every", type=int, default=2, help="of the film's frames, which are shown")
    parser.add_argument("--quality", type=int, default=45, help="1 to 100")
    options = parser.parse_args(arguments)
    film = cv2.VideoCapture(str(options.film))
    animation = cv2.Animation()
    frames = []
    while (read := film.read())[0]:
        frames.append(read[1])
    if not frames:
        raise SystemExit(f"moving_picture: {options.film}: no film that OpenCV reads")
    height = round(options.width * frames[0].shape[0] / frames[0].shape[1])
    shown = frames[:: options.every]
    animation.frames = [cv2.resize(frame, (options.width, height), interpolation=cv2.INTER_AREA) for frame in shown]
    animation.durations = [round(1000 * options.every / film.get(cv2.CAP_PROP_FPS))] * len(shown)
    if not cv2.imwriteanimation(str(options.out), animation, [cv2.IMWRITE_WEBP_QUALITY, options.quality]):
        raise SystemExit(f"moving_picture: {options.out}: cannot be written")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
