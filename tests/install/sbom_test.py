"""The bill of materials fits the schema of CycloneDX, which npm brings, and lists what Cotwin names, with the versions that are there.

    sbom_test.py NPM BOM.cdx.json WORK       exits with 77 where the schema cannot be had
"""
import copy
import json
import pathlib
import subprocess
import sys
import tarfile

import jsonschema

SCHEMA = "@cyclonedx/cyclonedx-library@10.3.0"
ROOT = pathlib.Path(__file__).resolve().parents[2]


def validator(npm, work):
    work.mkdir(parents=True, exist_ok=True)
    packed = subprocess.run([npm, "pack", SCHEMA, "--silent", "--prefer-offline"], cwd=work, capture_output=True, text=True)
    if packed.returncode != 0:
        print(f"the schema cannot be had: npm pack {SCHEMA} failed\n{packed.stderr}")
        sys.exit(77)
    schemas = {}
    with tarfile.open(work / packed.stdout.split()[-1]) as archive:
        for name in ("bom-1.6", "spdx", "jsf-0.82"):
            schemas[name] = json.load(archive.extractfile(f"package/res/schema/{name}.SNAPSHOT.schema.json"))
    schema = schemas["bom-1.6"]
    resolver = jsonschema.RefResolver.from_schema(schema, store={s["$id"]: s for s in schemas.values()})
    for name, one in schemas.items():   # the references are to the names of the files
        resolver.store[resolver.base_uri.rsplit("/", 1)[0] + f"/{name}.SNAPSHOT.schema.json"] = one
    return jsonschema.Draft7Validator(schema, resolver=resolver, format_checker=jsonschema.FormatChecker())


def main():
    npm, file, work = sys.argv[1:]
    bom = json.loads(pathlib.Path(file).read_text())
    components = bom["components"]

    # What is named, and its versions: from the other side, package by package.
    build = [line.split()[1] for line in (ROOT / "scripts/packages.txt").read_text().splitlines() if line.startswith("build ")]
    listed = {c["name"]: c for c in components if c["purl"].startswith("pkg:deb/")}
    assert sorted(listed) == sorted(set(build)), set(listed) ^ set(build)
    for name in build:
        version = subprocess.run(["dpkg-query", "-W", "-f", "${Version}", name], capture_output=True, text=True).stdout
        assert listed[name].get("version", "") == version, (name, version)
    assert listed["libsundials-dev"]["scope"] == "required" and listed["clang-14"]["scope"] == "excluded"
    lock = json.loads((ROOT / "master/view/page/package-lock.json").read_text())["packages"]
    pairs = {(place.rpartition("node_modules/")[2], package["version"]) for place, package in lock.items() if place}
    packages = [c for c in components if c["purl"].startswith("pkg:npm/")]
    assert {(c["name"], c["version"]) for c in packages} == pairs
    assert {c["name"] for c in packages if c["scope"] == "required"} == {"fflate", "three", "uplot"}
    references = {c["bom-ref"] for c in components}
    assert len(references) == len(components), "a package is there twice"
    assert set(bom["dependencies"][0]["dependsOn"]) == {c["bom-ref"] for c in components if c["scope"] == "required"}

    check = validator(npm, pathlib.Path(work))
    problems = [f"{list(e.absolute_path)}: {e.message[:200]}" for e in check.iter_errors(bom)]
    assert not problems, problems[:5]
    for spoil in (lambda b: b.pop("bomFormat"), lambda b: b["components"][0].pop("name"),
                  lambda b: b["components"][-1]["licenses"][0]["license"].update(id="No-Licence"),
                  lambda b: b["components"][0].update(scope="some"), lambda b: b.update(serialNumber="urn:uuid:1")):
        spoiled = copy.deepcopy(bom)
        spoil(spoiled)
        assert not check.is_valid(spoiled)
    print(f"{len(components)} components")


if __name__ == "__main__":
    main()
