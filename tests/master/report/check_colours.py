"""Checks the colours of curves in a style sheet: python3 check_colours.py page.css; prints what is wrong, exit code 1 if anything is.

Each pair of the colours --c0 ... --c7 must differ by 28 (CIE 1976, L*a*b*) for normal vision and for full protanopia, deuteranopia and
tritanopia as simulated by Machado, Oliveira, Fernandes, IEEE TVCG 15(6), 2009; the contrast to the ground must be at least 3 (WCAG 2.1, 1.4.11).
"""
import itertools
import math
import re
import sys

VISIONS = {
    "normal": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}


def linear(colour):
    values = [int(colour[i:i + 2], 16) / 255 for i in (1, 3, 5)]
    return [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in values]


def seen(colour, vision):
    rgb = linear(colour)
    return [min(1, max(0, sum(a * b for a, b in zip(row, rgb)))) for row in VISIONS[vision]]


def luminance(rgb):
    return 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]


def lab(rgb):
    r, g, b = rgb
    xyz = (0.4124 * r + 0.3576 * g + 0.1805 * b) / 0.95047, luminance(rgb), (0.0193 * r + 0.1192 * g + 0.9505 * b) / 1.08883
    x, y, z = [t ** (1 / 3) if t > 0.008856 else 7.787 * t + 16 / 116 for t in xyz]
    return 116 * y - 16, 500 * (x - y), 200 * (y - z)


def contrast(a, b):
    low, high = sorted((luminance(linear(a)), luminance(linear(b))))
    return (high + 0.05) / (low + 0.05)


failed = False
text = open(sys.argv[1], encoding="utf-8").read()
themes = re.findall(r":root\s*{(.*?)}", text, re.S)
if len(themes) != 2:
    sys.exit(f"{len(themes)} themes, expected light and dark")
for name, theme in zip(("light", "dark"), themes):
    colours = dict(re.findall(r"--(c\d|ground):\s*(#[0-9a-f]{6})", theme))
    if len(colours) != 9:
        sys.exit(f"{name}: {sorted(colours)}, expected c0 to c7 and ground")
    ground = colours.pop("ground")
    for key, colour in colours.items():
        if contrast(colour, ground) < 3:
            failed = True
            print(f"{name}: {key} {colour} has a contrast of {contrast(colour, ground):.2f} to the ground, expected at least 3")
    for (a, one), (b, other) in itertools.combinations(colours.items(), 2):
        for vision in VISIONS:
            difference = math.dist(lab(seen(one, vision)), lab(seen(other, vision)))
            if difference < 28:
                failed = True
                print(f"{name}, {vision}: {a} {one} and {b} {other} differ by {difference:.1f}, expected at least 28")
sys.exit(1 if failed else 0)
