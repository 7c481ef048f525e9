"""The cells of examples/notebooks run, one after the other, without Jupyter."""

import contextlib
import io
import json
import os
import unittest

from support import SOURCE, Case

FOLDER = SOURCE / "examples/notebooks"
MOST_BYTES = 20_000


class Notebooks(Case):
    def test_all_are_here(self):
        self.assertEqual(sorted(f.stem for f in FOLDER.glob("*.ipynb")), ["dynamics", "scenario", "services", "servicing", "tuning"])

    def test_they_are_small_and_without_outputs(self):
        for file in FOLDER.glob("*.ipynb"):
            with self.subTest(file.name):
                self.assertLess(file.stat().st_size, MOST_BYTES)
                notebook = json.loads(file.read_text())
                self.assertEqual(notebook["nbformat"], 4)
                for cell in notebook["cells"]:
                    self.assertIn(cell["cell_type"], ("code", "markdown"))
                    if cell["cell_type"] == "code":
                        self.assertEqual((cell["outputs"], cell["execution_count"]), ([], None))

    def run_cells(self, name, folder=None):
        before = os.getcwd()
        os.chdir(folder or self.folder)
        self.addCleanup(os.chdir, before)
        scope = {"__name__": "__main__"}
        cells = json.loads((FOLDER / f"{name}.ipynb").read_text())["cells"]
        for number, cell in enumerate(cells, 1):
            if cell["cell_type"] == "code":
                code = compile("".join(cell["source"]), f"{name}.ipynb, cell {number}", "exec")
                with contextlib.redirect_stdout(io.StringIO()):
                    exec(code, scope)
        return scope

    def test_servicing(self):
        scope = self.run_cells("servicing", FOLDER)
        self.assertAlmostEqual(scope["turn"][scope["t"] < 4.2].max(), 7.3642, delta=1e-3)
        (fixed, free), least = scope["found"][0], scope["least"]
        self.assertAlmostEqual(fixed, scope["at"]("fixed_mass.effective_mass", 15.0), delta=1e-6)
        self.assertLess(free, fixed)
        self.assertLess(least, free - 0.2)

    def test_scenario(self):
        scope = self.run_cells("scenario")
        self.assertTrue((self.folder / "arm.ssd").exists())
        self.assertLess(scope["error"], 1e-3)

    def test_dynamics(self):
        scope = self.run_cells("dynamics")
        self.assertLess(scope["difference"], 1e-10)

    def test_tuning(self):
        scope = self.run_cells("tuning")
        self.assertLess(max(scope["tuned"].held_out_rms), 0.1 * max(scope["tuned"].prior_held_out_rms))

    def test_services(self):
        scope = self.run_cells("services")
        self.assertLessEqual(scope["better"], scope["quintic"])


if __name__ == "__main__":
    unittest.main()
