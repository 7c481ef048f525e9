"""Writes the bill of materials of Cotwin's packages, CycloneDX 1.6 (ECMA-424) in JSON: what they are built from.

    sbom.py VERSION FILE.cdx.json

From scripts/packages.txt the Debian packages of the group build, with the versions that are installed here, and from the page's
package-lock.json the npm packages. "excluded" are those that only build or check; nothing of them is in the packages.
"""
import base64
import datetime
import json
import os
import pathlib
import subprocess
import sys
import uuid

ROOT = pathlib.Path(__file__).resolve().parent.parent
HEADERS_AND_LIBRARIES = ("-dev",)   # the names of Debian's packages of what is linked or included
WHILE_RUNNING = {"gnuplot-nox"}     # called, if it is there
NOT_LINKED = {"libomp-14-dev"}      # found by the compiler


def debian():
    lines = [line.split() for line in (ROOT / "scripts/packages.txt").read_text().splitlines() if line and not line.startswith("#")]
    names = [name for group, name in lines if group == "build"]
    try:
        asked = subprocess.run(["dpkg-query", "-W", "-f", "${Package} ${Version} ${Architecture}\n", *names],
                               capture_output=True, text=True)
        installed = {name: (version, arch) for name, version, arch in (line.split() for line in asked.stdout.splitlines())}
    except OSError:   # another system: what is there has no version here
        installed = {}
    for name in names:
        version, arch = installed.get(name, ("", ""))
        linked = name.endswith(HEADERS_AND_LIBRARIES) and name not in NOT_LINKED
        purl = f"pkg:deb/debian/{name}" + (f"@{version.replace('+', '%2B').replace(':', '%3A')}?arch={arch}" if version else "")
        component = {"type": "library" if linked else "application", "bom-ref": purl, "supplier": {"name": "Debian"},
                     "name": name, "scope": "required" if linked else "optional" if name in WHILE_RUNNING else "excluded",
                     "purl": purl}
        if version:
            component["version"] = version
        yield component


def npm():
    lock = json.loads((ROOT / "master/view/page/package-lock.json").read_text())
    packages = lock["packages"]
    wanted = set()   # what the page has: its bundler, and what that needs, stay out

    def want(name):
        if name not in wanted:
            wanted.add(name)
            for below in packages["node_modules/" + name].get("dependencies", {}):
                want(below)

    for name in packages[""]["dependencies"]:
        if name != "vite":
            want(name)
    seen = set()
    for place, package in packages.items():
        name = place.rpartition("node_modules/")[2]
        purl = f"pkg:npm/{name.replace('@', '%40')}@{package['version']}"
        if not place or purl in seen:
            continue
        seen.add(purl)
        component = {"type": "library", "bom-ref": purl, "name": name, "version": package["version"],
                     "scope": "required" if name in wanted else "excluded", "purl": purl}
        algorithm, _, digest = package.get("integrity", "").partition("-")
        if algorithm == "sha512":
            component["hashes"] = [{"alg": "SHA-512", "content": base64.b64decode(digest).hex()}]
        if "license" in package:
            component["licenses"] = [{"license": {"id": package["license"]}}]
        yield component


def main():
    version, out = sys.argv[1:]
    own = f"pkg:generic/cotwin@{version}"
    components = [*debian(), *npm()]
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    time = datetime.datetime.fromtimestamp(int(epoch), datetime.timezone.utc) if epoch else datetime.datetime.now(datetime.timezone.utc)
    text = json.dumps(components, sort_keys=True)
    bom = {
        "$schema": "http://cyclonedx.org/schema/bom-1.6.schema.json",
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "serialNumber": f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, own + text)}",   # the same content, the same number
        "version": 1,
        "metadata": {
            "timestamp": time.strftime("%Y-%m-%dT%H:%M:%SZ"),
            "component": {"type": "application", "bom-ref": own, "name": "cotwin", "version": version, "purl": own,
                          "supplier": {"name": "The Cotwin developers"}, "licenses": [{"license": {"id": "Apache-2.0"}}]},
        },
        "components": components,
        "dependencies": [{"ref": own, "dependsOn": [c["bom-ref"] for c in components if c["scope"] == "required"]}],
        # Of Debian's packages those that Cotwin names, not what they need themselves.
        "compositions": [{"aggregate": "incomplete", "assemblies": [own]}],
    }
    pathlib.Path(out).write_text(json.dumps(bom, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
