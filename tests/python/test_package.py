"""What is shipped: stubs that agree with the module, docstrings, and no part that is missing."""

import ast
import inspect
import re
import subprocess
import sys
import unittest
from pathlib import Path

import cotwin
from cotwin import _native
from support import PROGRAM, Case

FOLDER = Path(cotwin.__file__).parent


def stubs():
    """Classes and functions of _native.pyi: name → members, with the names of their arguments."""
    found = {}
    for node in ast.parse((FOLDER / "_native.pyi").read_text()).body:
        if isinstance(node, ast.ClassDef):
            members = {}
            for one in node.body:
                if isinstance(one, ast.FunctionDef):
                    members[one.name] = [a.arg for a in one.args.args + one.args.kwonlyargs]
                elif isinstance(one, ast.AnnAssign):
                    members[one.target.id] = ["self"]
            found[node.name] = members
        elif isinstance(node, ast.FunctionDef):
            found[node.name] = [a.arg for a in node.args.args + node.args.kwonlyargs]
    return found


def arguments_of(function):
    """Names of the arguments in the signature that pybind11 writes into the docstring."""
    signature = re.match(r"\w+\((.*)\) ->", function.__doc__.splitlines()[0])[1]
    return re.findall(r"(\w+): (?!:)", re.sub(r"\[[^\]]*\]|= [^,]*", "", signature))


class Stubs(Case):
    def test_names_and_arguments_are_those_of_the_module(self):
        typed = {name: value for name, value in stubs().items() if not name.startswith("_")}
        there = {name for name in dir(_native) if not name.startswith("_")}
        self.assertEqual(set(typed), there)
        for name, members in typed.items():
            thing = getattr(_native, name)
            if isinstance(members, list):
                self.assertEqual(arguments_of(thing), members, name)
                continue
            public = {m for m in vars(thing) if not m.startswith("_") or m in ("_run", "_recording")}
            self.assertEqual({m for m in members if not m.startswith("__")}, public if name != "Error" else set(), name)
            for member, arguments in members.items():
                value = inspect.getattr_static(thing, member)
                if isinstance(value, property):
                    self.assertEqual(arguments, ["self"], f"{name}.{member}")
                else:
                    self.assertEqual(arguments_of(getattr(thing, member)), arguments, f"{name}.{member}")

    def test_the_package_is_marked_as_typed(self):
        self.assertTrue((FOLDER / "py.typed").exists())

    def test_each_public_name_has_a_docstring(self):
        for name in cotwin.__all__:
            thing = getattr(cotwin, name)
            self.assertTrue(inspect.getdoc(thing), name)
            if not inspect.isclass(thing):
                continue
            for member, value in inspect.getmembers(thing):
                own = any(member in vars(base) for base in thing.__mro__ if base.__module__.startswith("cotwin"))
                if own and not member.startswith("_"):
                    text = inspect.getdoc(value)
                    if inspect.isroutine(value) or isinstance(value, property):
                        self.assertTrue(text, f"{name}.{member}")

    def test_results_of_robots_have_shape_and_unit_in_their_docstrings(self):
        for name in ("mass_matrix", "gravity", "bias", "coriolis_matrix", "inverse_dynamics", "forward_dynamics", "jacobian"):
            text = getattr(cotwin.Robot, name).__doc__
            self.assertRegex(text, r"states, n|\(6, n\)", name)
            self.assertRegex(text, r"N\.m|rad/s|kg", name)


class Module(Case):
    def test_the_version_is_that_of_the_program(self):
        done = subprocess.run([PROGRAM, "--version"], check=True, capture_output=True, text=True)
        self.assertIn(cotwin.__version__, done.stdout)

    def test_the_error_is_a_runtime_error_of_cotwin(self):
        self.assertTrue(issubclass(cotwin.Error, RuntimeError))
        self.assertEqual(cotwin.Error.__module__, "cotwin")

    def test_an_interpreter_that_ends_in_the_middle_ends_quietly(self):
        code = """
import cotwin
class U(cotwin.Unit):
    def declare(self):
        self.output("y")
    def step(self, t, h):
        pass
kept = cotwin.Simulation(cotwin.Scenario(stop=1).add("u", U))
kept.step()
view = kept.view("u.y")
robot = cotwin.Robot("planar2")
"""
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        self.assertEqual((done.returncode, done.stdout, done.stderr), (0, "", ""))


if __name__ == "__main__":
    unittest.main()
