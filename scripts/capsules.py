#!/usr/bin/env python3
"""Encloses the meshes of a robot's links in capsules, cylinders and boxes, and proves that all vertices are inside.

capsules.py ROBOT.urdf [--shapes N] [-o FILE]

ROBOT.urdf: links with <collision> meshes, else <visual> meshes (.stl, .obj; package://p/x is searched as x and p/x in the URDF's folder and those
above). N: at most so many shapes per link (default 3). FILE: default is what robot_shapes=hulls reads: hulls.urdf beside robot.urdf,
NAME_hulls.urdf beside NAME.urdf. Each link is cut by planes where that saves most volume, triangles included, so that whole surfaces are inside.
Needs numpy (Debian: python3-numpy)."""
import argparse
import itertools
import pathlib
import sys
import xml.etree.ElementTree as ElementTree

import numpy as np

LEAST_SAVING = 0.06   # of a link's volume, for which it gets one shape more
PREFERENCE = {"capsule": 1.0, "cylinder": 1.0, "box": 1.5}   # weights of volumes: links are mostly round
SAMPLE = 3000         # triangles on which cuts are tried
SLACK = 2e-5          # m, covers the rounding of the numbers in the file


def rotation(rpy):
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy), np.cos(rpy)
    return np.array([[cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                     [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr], [-sp, cp * sr, cp * cr]])


def rpy_of(R):
    pitch = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    if np.hypot(R[0, 0], R[1, 0]) < 1e-9:
        return np.array([np.arctan2(-R[1, 2], R[1, 1]), pitch, 0])
    return np.array([np.arctan2(R[2, 1], R[2, 2]), pitch, np.arctan2(R[1, 0], R[0, 0])])


def numbers(element, name, default):
    return np.array([float(word) for word in element.get(name, default).split()]) if element is not None else np.array([float(w) for w in default.split()])


def triangles_of(file):
    """Corners of the triangles, n × 3 × 3."""
    data = file.read_bytes()
    if file.suffix.lower() == ".stl":
        count = int.from_bytes(data[80:84], "little") if len(data) >= 84 else -1
        if len(data) == 84 + 50 * count:
            records = np.frombuffer(data[84:], np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")]))
            return records["corners"].astype(float)
        words = [line.split()[1:4] for line in data.decode(errors="replace").splitlines() if line.strip().startswith("vertex")]
        return np.array(words, float).reshape(-1, 3, 3)
    if file.suffix.lower() == ".obj":
        lines = [line.split() for line in data.decode(errors="replace").splitlines()]
        points = np.array([line[1:4] for line in lines if line[:1] == ["v"]], float)
        faces = [[int(word.split("/")[0]) for word in line[1:]] for line in lines if line[:1] == ["f"]]
        fans = [(face[0], a, b) for face in faces for a, b in zip(face[1:], face[2:])]
        return points[np.array([[i - 1 if i > 0 else i for i in fan] for fan in fans], int).reshape(-1, 3)]
    sys.exit(f"{file}: expected .stl or .obj")


def find_mesh(urdf, name):
    path = name.removeprefix("package://")
    tails = [path, path.partition("/")[2]] if name.startswith("package://") else [name.removeprefix("file://")]
    for folder, tail in itertools.product([urdf.parent, *urdf.resolve().parents], filter(None, tails)):
        if (folder / tail).is_file():
            return folder / tail
    sys.exit(f"{urdf}: the mesh '{name}' is not found")


def meshes_of(urdf):
    """{link: triangles in its frame} of the links with meshes."""
    links = {}
    for link in ElementTree.parse(urdf).getroot().findall("link"):
        for kind in ("collision", "visual"):
            for piece in link.findall(kind):
                mesh, origin = piece.find("geometry/mesh"), piece.find("origin")
                if mesh is None:
                    continue
                file = find_mesh(urdf, mesh.get("filename"))
                try:
                    corners = triangles_of(file) * numbers(mesh, "scale", "1 1 1")
                except (ValueError, IndexError) as error:
                    sys.exit(f"{file}: {error}, expected triangles as STL or OBJ")
                if len(corners) == 0 or not np.isfinite(corners).all():
                    sys.exit(f"{file}: no triangles with finite corners")
                placed = corners @ rotation(numbers(origin, "rpy", "0 0 0")).T + numbers(origin, "xyz", "0 0 0")
                links.setdefault(link.get("name"), []).append(placed)
            if link.get("name") in links:
                break
    return {name: np.concatenate(parts) for name, parts in links.items()}


def smallest_circle(points):
    """Centre of the smallest circle around points of the plane: the farthest point joins those that carry the circle until none is outside."""
    def around(support):
        if len(support) == 2:
            return (support[0] + support[1]) / 2
        A, b = 2 * (support[1:] - support[0]), (support[1:] ** 2 - support[0] ** 2).sum(axis=1)
        return np.linalg.lstsq(A, b, rcond=None)[0]
    support, centre = points[:1], points[0]
    for _ in range(100):
        distance = np.linalg.norm(points - centre, axis=1)
        far = points[distance.argmax()]
        if distance.max() <= np.linalg.norm(support - centre, axis=1).max() + 1e-9:
            break
        best = np.inf
        joined = np.vstack([support, far])
        for n in (2, 3):
            for chosen in itertools.combinations(joined, n):
                c = around(np.array(chosen))
                radius = np.linalg.norm(joined - c, axis=1).max()
                if radius < best - 1e-12:
                    best, centre, support = radius, c, np.array(chosen)
    return centre


def principal_axes(points):
    """Columns: the axes of the points' covariance."""
    centred = points - points.mean(axis=0)
    return np.linalg.eigh(centred.T @ centred)[1]


def fit(points):
    """(weighted volume, kind, size, R, p) of the best shape around the points. Sizes and poses as in a URDF."""
    best = (np.inf,)
    frames = [np.eye(3), principal_axes(points)]
    for frame in frames:
        frame = frame * np.sign(np.linalg.det(frame))
        low, high = (points @ frame).min(axis=0), (points @ frame).max(axis=0)
        edges = high - low + SLACK
        best = min(best, (PREFERENCE["box"] * edges.prod(), "box", edges, frame, frame @ (low + high) / 2), key=lambda s: s[0])
        for axis in range(3):
            R = frame[:, [(axis + 1) % 3, (axis + 2) % 3, axis]]
            flat, h = points @ R[:, :2], points @ R[:, 2]
            centre = smallest_circle(flat)
            rho = np.linalg.norm(flat - centre, axis=1)
            r = rho.max() + SLACK
            length, middle = np.ptp(h) + SLACK, (h.min() + h.max()) / 2
            best = min(best, (PREFERENCE["cylinder"] * np.pi * r * r * length, "cylinder", (r, length), R, R @ [*centre, middle]), key=lambda s: s[0])
            for r in r * np.array([1, 1.03, 1.08, 1.15]):
                cap = np.sqrt(np.maximum(r * r - rho * rho, 0))
                top, bottom = (h - cap).max(), (h + cap).min()
                length = max(top - bottom, 1e-3) + SLACK
                volume = PREFERENCE["capsule"] * np.pi * r * r * (length + 4 / 3 * r)
                best = min(best, (volume, "capsule", (r + SLACK, length), R, R @ [*centre, (top + bottom) / 2]), key=lambda s: s[0])
    return best


def cut(triangles, normal, at):
    """The triangles on both sides of a plane; those across it are cut."""
    height = triangles @ normal - at
    sides = []
    for sign in (1, -1):
        inside = sign * height >= 0
        across = inside.any(axis=1) & ~inside.all(axis=1)
        parts = [triangles[inside.all(axis=1)]]
        for corners, h in zip(triangles[across], height[across]):
            ring = []
            for k in range(3):
                a, b = h[k], h[(k + 1) % 3]
                if sign * a >= 0:
                    ring.append(corners[k])
                if (a >= 0) != (b >= 0):
                    ring.append(corners[k] + a / (a - b) * (corners[(k + 1) % 3] - corners[k]))
            parts.append(np.array([[ring[0], ring[i], ring[i + 1]] for i in range(1, len(ring) - 1)]).reshape(-1, 3, 3))
        sides.append(np.concatenate(parts))
    return sides


DIRECTIONS = np.random.default_rng(1).normal(size=(100, 3))


def outermost(triangles):
    """The corners that are outermost in many directions: they decide on the shape."""
    points = triangles.reshape(-1, 3)
    return points[np.unique((points @ DIRECTIONS.T).argmax(axis=0))]


def best_cut(shape, triangles, principal):
    """(saved volume, normal, distance from the origin) of the plane that saves most, on a sample of the triangles. Planes are across the axes of the
    link and, if wanted, the principal axes of the piece."""
    sample = triangles[::1 + len(triangles) // SAMPLE]
    points = outermost(sample)
    normals = np.eye(3)
    if principal:
        normals = np.vstack([normals, principal_axes(points).T])
    best = (-np.inf, None, 0)
    for normal in normals:
        low, high = (points @ normal).min(), (points @ normal).max()
        for at in np.linspace(low, high, 18)[1:-1]:
            sides = cut(sample, normal, at)
            if min(map(len, sides)) > 0:
                saved = shape[0] - sum(fit(outermost(side))[0] for side in sides)
                best = max(best, (saved, normal, at), key=lambda b: b[0])
    return best


def enclose(triangles, most):
    """Shapes around the triangles, each (kind, size, R, p). Two cuts may save what one does not, so that all numbers up to `most` are tried, each
    with and without cuts across principal axes."""
    tried = []
    for principal in (False, True):
        def piece_of(part):
            shape = fit(outermost(part))
            return shape, part, best_cut(shape, part, principal)
        pieces = [piece_of(triangles)]
        tried.append(pieces)
        while len(pieces) < most:
            k = max(range(len(pieces)), key=lambda i: pieces[i][2][0])
            _, normal, at = pieces[k][2]
            if normal is None:
                break
            pieces = pieces[:k] + [piece_of(side) for side in cut(pieces[k][1], normal, at)] + pieces[k + 1:]
            tried.append(pieces)
    def price(pieces):
        return sum(shape[0] for shape, _, _ in pieces) / (1 - LEAST_SAVING) ** len(pieces)
    return [fit(part.reshape(-1, 3))[1:] for _, part, _ in min(tried, key=price)]


def element_of(kind, size, R, p):
    collision = ElementTree.Element("collision")
    ElementTree.SubElement(collision, "origin", xyz=" ".join(f"{x:.5f}" for x in p), rpy=" ".join(f"{x:.6f}" for x in rpy_of(R)))
    words = {"size": " ".join(f"{x:.5f}" for x in size)} if kind == "box" else {"radius": f"{size[0]:.5f}", "length": f"{size[1]:.5f}"}
    ElementTree.SubElement(ElementTree.SubElement(collision, "geometry"), kind, words)
    return collision


def beyond(collision, points):
    """How far each point is outside a shape as the file says it, m; negative: inside."""
    origin, shape = collision.find("origin"), collision.find("geometry")[0]
    local = np.abs((points - numbers(origin, "xyz", "0 0 0")) @ rotation(numbers(origin, "rpy", "0 0 0")))
    if shape.tag == "box":
        return (local - numbers(shape, "size", "") / 2).max(axis=1)
    radius, half = float(shape.get("radius")), float(shape.get("length")) / 2
    rho = np.hypot(local[:, 0], local[:, 1])
    if shape.tag == "cylinder":
        return np.maximum(rho - radius, local[:, 2] - half)
    return np.hypot(rho, np.maximum(local[:, 2] - half, 0)) - radius


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("urdf", type=pathlib.Path, metavar="ROBOT.urdf")
    parser.add_argument("--shapes", type=int, default=3, metavar="N")
    parser.add_argument("-o", type=pathlib.Path, dest="out", metavar="FILE")
    arguments = parser.parse_args()
    urdf = arguments.urdf
    try:
        links = meshes_of(urdf)
    except (OSError, ElementTree.ParseError) as error:
        sys.exit(f"{urdf}: {error}, expected a URDF")
    if not links:
        sys.exit(f"{urdf}: no link has a mesh, expected <collision> or <visual> with <mesh>")
    robot = ElementTree.Element("robot", name=ElementTree.parse(urdf).getroot().get("name", ""))
    for name, triangles in links.items():
        link = ElementTree.SubElement(robot, "link", name=name)
        link.extend(element_of(*shape) for shape in enclose(triangles, arguments.shapes))
        points = triangles.reshape(-1, 3)
        outside = np.min([beyond(collision, points) for collision in link], axis=0).max()
        kinds = ", ".join(collision.find("geometry")[0].tag for collision in link)
        print(f"{name}: {kinds}; {len(points)} vertices, the outermost {1e3 * outside:.3f} mm outside")
        if outside > 0:
            sys.exit(f"{name}: a vertex is outside; nothing is written")
    ElementTree.indent(robot)
    out = arguments.out or urdf.with_name("hulls.urdf" if urdf.name == "robot.urdf" else urdf.stem + "_hulls.urdf")
    out.write_bytes(b'<?xml version="1.0"?>\n' + ElementTree.tostring(robot) + b"\n")
    print(out)


if __name__ == "__main__":
    main()
