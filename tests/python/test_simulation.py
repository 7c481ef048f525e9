import gc
import os
import subprocess
import threading
import unittest
import warnings
import zipfile
from pathlib import Path

import numpy as np

import cotwin
from support import PROGRAM, SOURCE, Case, Q0, Q1, arm

EXAMPLE = SOURCE / "examples/02_free_motion_lwr4/twin.ssd"


class Run(Case):
    def test_writes_the_same_bits_as_the_program(self):
        command = [PROGRAM, "run", EXAMPLE, "--stop", "0.6", "--set", "drive.K=2e4", "--out", self.folder / "program"]
        subprocess.run(command, check=True, capture_output=True, cwd=self.folder)
        result = cotwin.run(EXAMPLE, stop=0.6, set={"drive.K": 2e4}, results=self.folder / "python")
        self.assertEqual(result.run.recording_file, self.folder / "python/signals.csv")
        self.assertEqual((self.folder / "python/signals.csv").read_bytes(), (self.folder / "program/signals.csv").read_bytes())

    def test_errors_are_also_of_python_s_own_kinds_and_speak_python(self):
        simulation = cotwin.Simulation(EXAMPLE, stop=0.1)
        for use in (lambda: simulation["drive.qq"], lambda: simulation.view("drive.qq"), lambda: simulation.set("drive.qq", 1.0)):
            with self.assertRaises(KeyError) as unknown:
                use()
            self.assertIsInstance(unknown.exception, cotwin.Error)
            self.assertIn("drive.q", str(unknown.exception))
            self.assertNotEqual(str(unknown.exception)[0], "'")  # the message, not its repr
        for wrong in ([1.0, 2.0], np.ma.MaskedArray(np.zeros(7), mask=[True] + [False] * 6), np.zeros((7, 1)), np.zeros(7) * 1j):
            with self.assertRaises(ValueError):
                simulation["drive.tau_e"] = wrong
        simulation["drive.tau_e"] = np.arange(7)
        np.testing.assert_array_equal(simulation["drive.tau_e"], np.arange(7.0))
        with self.assertRaises(FileNotFoundError):
            cotwin.Simulation(self.folder / "none.ssd")
        with self.assertRaises(FileNotFoundError):
            cotwin.Recording.load(self.folder / "none.csv")
        with self.assertRaises(KeyError):
            cotwin.run(EXAMPLE, stop=0.01).recording["drive.qq"]
        with self.assertError('set=["drive.methd=cvode"]: drive: no variable and no setting', "did you mean 'method'?") as told:
            cotwin.Simulation(EXAMPLE, set={"drive.methd": "cvode"})
        self.assertNotIn("--", str(told.error))
        with self.assertRaises(KeyError):
            cotwin.Simulation(EXAMPLE, set={"drive.methd": "cvode"})
        with self.assertError('set=["drive.K=1 2"]: K: 2 values'):
            cotwin.Simulation(EXAMPLE, set={"drive.K": [1, 2]})
        with self.assertError("give stop=SECONDS"):
            cotwin.Simulation(EXAMPLE, stop=-1)
        with self.assertError("another robot: set=[", "did you mean 'lwr4'?") as told:
            cotwin.Simulation(EXAMPLE, set={"robot": "lwr"})
        self.assertNotIn("--", str(told.error))

    def test_steps_one_by_one_give_the_bits_of_a_run(self):
        whole = cotwin.run(EXAMPLE, stop=0.1)
        simulation = cotwin.Simulation(EXAMPLE, stop=0.1)
        while simulation.step():
            simulation["drive.tau_J"]
        np.testing.assert_array_equal(simulation.recording().values, whole.recording.values)

    def test_rows_in_memory_are_those_of_the_file(self):
        for stop in (0.1, 0.105):  # the second ends between two recorded ticks
            with self.subTest(stop):
                folder = self.folder / str(stop)
                result = cotwin.run(EXAMPLE, stop=stop, results=folder)
                file = cotwin.Recording.load(folder)
                self.assertEqual(result.recording.names, file.names)
                np.testing.assert_array_equal(result.recording.values, file.values)
                self.assertEqual(len(file), result.run.rows)

    def test_files_of_an_earlier_run_in_the_folder_are_kept_apart(self):
        command = [PROGRAM, "run", EXAMPLE, "--stop", "0.1", "--out", self.folder]
        subprocess.run(command, check=True, capture_output=True, cwd=self.folder)
        of_program = (self.folder / "signals.csv").read_bytes()
        first = cotwin.run(EXAMPLE, stop=0.2, results=self.folder)
        self.assertEqual((self.folder / "earlier-1/signals.csv").read_bytes(), of_program)
        self.assertEqual(sorted(one.name for one in (self.folder / "earlier-1").iterdir()), ["run.json", "signals.csv", "summary.json", "view.bin"])
        self.assertEqual(sorted(one.name for one in self.folder.iterdir()), ["earlier-1", "signals.csv", "view.bin"])
        cotwin.run(EXAMPLE, stop=0.3, results=self.folder)
        np.testing.assert_array_equal(cotwin.Recording.load(self.folder / "earlier-2").values, first.recording.values)

    def test_one_run_at_a_time_writes_to_a_folder(self):
        simulation = cotwin.Simulation(EXAMPLE, results=self.folder)
        simulation.step()
        with self.assertError(str(self.folder), "is writing there"):
            cotwin.run(EXAMPLE, stop=0.1, results=self.folder)
        simulation.finish()
        cotwin.run(EXAMPLE, stop=0.1, results=self.folder)

    def test_figures_and_times_are_those_of_the_run(self):
        result = cotwin.run(EXAMPLE, stop=0.7)
        self.assertEqual((result.run.start, result.reached, result.run.stop, result.run.ticks), (0, 0.7, 0.7, 700))
        figure = result.figures["joint torque"]
        self.assertEqual((figure.signal, figure.si, figure.rms.shape), ("drive.tau_J", "N.m", (7,)))
        self.assertGreaterEqual(figure.total_max, np.max(figure.max))

    def test_without_keep_nothing_is_kept(self):
        result = cotwin.run(EXAMPLE, stop=0.01, keep=False)
        with self.assertError("keep_rows"):
            result.recording


class Step(Case):
    def setUp(self):
        super().setUp()
        self.simulation = cotwin.Simulation(arm(stop=0.5))

    def test_integers_that_floats_do_not_have_are_refused(self):
        simulation = cotwin.Simulation(arm())
        for value in (2**53 + 1, [1] * 6 + [2**53 + 1], np.array([2**60] * 7)):
            with self.subTest(value), self.assertError("drive.tau_e", "2^53 or more"):
                simulation["drive.tau_e"] = value
        simulation["drive.tau_e"] = [1] * 7
        np.testing.assert_array_equal(simulation["drive.tau_e"], np.ones(7))

    def test_values_are_set_and_read(self):
        s = self.simulation
        s["drive.K"] = np.full(7, 2e4)
        s.set("drive.K[2]", 1e4)
        np.testing.assert_array_equal(s["drive.K"], [2e4, 1e4, 2e4, 2e4, 2e4, 2e4, 2e4])
        self.assertTrue(s.step())
        self.assertEqual(s.time, 0.001)
        s["drive.tau_e"] = [1, 2, 3, 4, 5, 6, 7]
        s["drive.tau_e[7]"] = 8
        self.assertEqual(s["drive.tau_e"].tolist(), [1, 2, 3, 4, 5, 6, 8])
        self.assertTrue(s.run_to(0.0105))
        self.assertEqual(s.time, 0.011)
        self.assertEqual(s.stop, 0.5)

    def test_a_view_shows_the_present_values_and_keeps_the_simulation_alive(self):
        q = self.simulation.view("drive.q")
        self.assertFalse(q.flags.writeable)
        self.assertFalse(q.flags.owndata)
        with self.assertRaises(ValueError):
            q[0] = 1
        self.simulation.run_to(0.3)
        first = q.copy()
        np.testing.assert_array_equal(q, self.simulation["drive.q"])
        self.simulation.run_to(0.35)
        self.assertTrue(np.any(q != first))
        del self.simulation
        gc.collect()
        self.assertTrue(np.all(np.isfinite(q)))

    def test_variables_have_role_unit_and_meaning(self):
        found = {v.name: v for v in self.simulation.variables()}
        self.assertEqual((found["drive.tau_J"].role, found["drive.tau_J"].si, found["drive.tau_J"].size), ("output", "N.m", 7))
        self.assertEqual(found["motion.passing"].kind, "string")
        self.simulation.set("motion.passing", "through")
        self.assertEqual(self.simulation.get_text("motion.passing"), "through")

    def test_values_that_do_not_fit_are_errors_and_change_nothing(self):
        s = self.simulation
        before = s["drive.K"]
        for value, part in ((np.full(7, np.nan), "nan"), (np.full(7, -1.0), "expected"), ([1, 2], "2 values"), (np.zeros((7, 1)), "(7, 1)")):
            with self.subTest(value), self.assertError("drive.K", part):
                s["drive.K"] = value
        with self.assertError("drive.K", "'soft' is a text, expected 7 numbers"):
            s["drive.K"] = "soft"
        with self.assertError("drive.K"):
            s["drive.K"] = np.zeros(14)[::2]
        with self.assertError("no variable 'drive.tau_j'", "did you mean"):
            s["drive.tau_j"]
        with self.assertError("drive.q[8]"):
            s["drive.q[8]"]
        np.testing.assert_array_equal(s["drive.K"], before)
        s.step()
        with self.assertError("drive.K", "parameter"):
            s["drive.K"] = 1e4
        with self.assertError("drive.tau_m", "is fed by compliance.tau_m"):
            s["drive.tau_m"] = np.zeros(7)
        with self.assertError("motion.passing", "string"):
            s["motion.passing"]
        with self.assertError("t is not finite"):
            s.run_to(float("inf"))

    def test_after_the_end_steps_do_nothing(self):
        self.assertFalse(self.simulation.run_to(1))
        self.assertFalse(self.simulation.step())
        self.assertEqual(self.simulation.time, 0.5)
        with self.assertError("started before"):
            self.simulation.start()

    def test_finish_keeps_the_rows_so_far(self):
        with cotwin.Simulation(EXAMPLE, results=self.folder) as s:
            s.run_to(0.2)
        self.assertFalse(s.step())
        self.assertEqual(cotwin.Recording.load(self.folder).time[-1], 0.2)


class Threads(Case):
    def test_two_threads_at_once_are_refused(self):
        class Wait(cotwin.Unit):
            inside, go = threading.Event(), threading.Event()

            def declare(self):
                self.output("y")

            def step(self, t, h):
                self.inside.set()
                self.go.wait(30)

        simulation = cotwin.Simulation(cotwin.Scenario(stop=0.001).add("wait", Wait))
        thread = threading.Thread(target=simulation.step)
        thread.start()
        self.assertTrue(Wait.inside.wait(30))
        with self.assertError("in use by another thread"):
            simulation.step()
        with self.assertError("in use"):
            simulation["wait.y"]
        Wait.go.set()
        thread.join()
        self.assertEqual(simulation.time, 0.001)

    def test_runs_in_threads_do_not_disturb_one_another(self):
        expected = cotwin.run(EXAMPLE, stop=0.3).recording.values
        results = [None] * 3

        def work(i):
            results[i] = cotwin.run(EXAMPLE, stop=0.3).recording.values

        threads = [threading.Thread(target=work, args=(i,)) for i in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for values in results:
            np.testing.assert_array_equal(values, expected)

    def test_a_forked_process_is_refused_and_ends_cleanly(self):
        simulation = cotwin.Simulation(EXAMPLE, stop=0.2, results=self.folder)
        simulation.run_to(0.1)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            child = os.fork()
        if child == 0:
            code = 1
            try:
                simulation.step()
            except cotwin.Error as error:
                code = 0 if "another process" in str(error) else 2
            del simulation
            gc.collect()
            os._exit(code)
        self.assertEqual(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), 0)
        simulation.run()
        self.assertEqual(cotwin.Recording.load(self.folder).time[-1], 0.2)

    def test_an_fmu_of_another_tool_cannot_end_the_interpreter(self):
        with zipfile.ZipFile(self.folder / "harm2.fmu", "w") as archive:
            archive.write(SOURCE / "tests/fmu/fmus/harm2.xml", "modelDescription.xml")
            archive.write(Path(os.environ["COTWIN_FOREIGN"]) / "harm2.so", "binaries/linux64/harm.so")
        (self.folder / "plant.ssd").write_text(PLANT)
        self.addCleanup(os.environ.pop, "COTWIN_HARM")
        self.addCleanup(os.environ.pop, "COTWIN_HARM_AT")
        os.environ["COTWIN_HARM_AT"] = "fmi2DoStep"
        for harm, end in ("_exit", "exited with status 0"), ("kill", "was killed by signal 9"):
            os.environ["COTWIN_HARM"] = harm
            simulation = cotwin.Simulation(self.folder / "plant.ssd", results=self.folder / "results")
            with self.assertError("pump at t = 0.5 s: harm2.fmu: ", end, "in fmi2DoStep"):
                simulation.run()
            self.assertEqual(len(cotwin.Recording.load(self.folder / "results").time), 51)


PLANT = """<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription version="1.0" name="plant"
    xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription">
  <ssd:System name="plant">
    <ssd:Elements>
      <ssd:Component name="pump" source="harm2.fmu" type="application/x-fmu-sharedlibrary"/>
    </ssd:Elements>
  </ssd:System>
  <ssd:DefaultExperiment startTime="0" stopTime="1">
    <ssd:Annotations><ssc:Annotation xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" type="cotwin.master">
      <cotwin:Master xmlns:cotwin="urn:cotwin:master:1" tick="0.01"/>
    </ssc:Annotation></ssd:Annotations>
  </ssd:DefaultExperiment>
</ssd:SystemStructureDescription>
"""


if __name__ == "__main__":
    unittest.main()
