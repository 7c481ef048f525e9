import subprocess
import unittest
import xml.etree.ElementTree as ElementTree

import numpy as np

import cotwin
from support import PROGRAM, SOURCE, Case, Q0, arm


class Build(Case):
    def test_saved_scenario_runs_in_the_program_and_gives_the_same_bits(self):
        scenario = arm(stop=0.2).record("drive.*", "motion.q_d").report("tracking error", "drive.q", "motion.q_d")
        file = scenario.save(self.folder / "arm.ssd")
        subprocess.run([PROGRAM, "run", file, "--out", self.folder / "program"], check=True, capture_output=True, cwd=self.folder)
        program = (self.folder / "program/signals.csv").read_bytes()
        result = scenario.run(results=self.folder / "built")
        self.assertEqual((self.folder / "built/signals.csv").read_bytes(), program)
        cotwin.run(file, results=self.folder / "loaded")
        self.assertEqual((self.folder / "loaded/signals.csv").read_bytes(), program)
        self.assertEqual(result.figures["tracking error"].signal, "drive.q - motion.q_d")

    def test_saved_scenario_passes_the_check_of_the_program(self):
        file = arm().event(0.5, "drive.tau_e[2]", 5, ramp=0.01).save(self.folder / "arm.ssd")
        done = subprocess.run([PROGRAM, "check", file], capture_output=True, text=True, cwd=self.folder)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)

    def test_numbers_keep_all_their_bits(self):
        q0 = np.nextafter(Q0, 1)
        s = cotwin.Scenario(robot="lwr4")
        s.add("drive", "drive_train", values={"q0": q0})
        np.testing.assert_array_equal(cotwin.Simulation(s).get("drive.q0"), q0)

    def test_components_follow_one_another_in_stages_unless_given(self):
        text = arm().add("late", "indices", stage=1, frame="link_7").to_ssd()
        for part in ('"motion" stage="0"', '"compliance" stage="1"', '"drive" stage="2"', '"late" stage="1"'):
            self.assertIn(f"<cotwin:Component name={part}/>", text)

    def test_markup_in_names_and_values_is_escaped(self):
        name = 'a<b>&"c\''
        s = cotwin.Scenario(name, robot="lwr4").add("motion", values={"note": '<script>&"'}, kind="way&points=1%")
        root = ElementTree.fromstring(s.to_ssd())
        self.assertEqual(root.get("name"), name)
        source = next(root.iter("{http://ssp-standard.org/SSP1/SystemStructureDescription}Component")).get("source")
        self.assertEqual(source, "unit:motion?kind=way%26points%3D1%25")

    def test_connections_are_scaled_by_factor_and_offset(self):
        s = cotwin.Scenario(stop=0.01)

        class One(cotwin.Unit):
            def declare(self):
                self.output("y", 2, start=0)

            def step(self, t, h):
                self.y = [1, 2]

        class Two(cotwin.Unit):
            def declare(self):
                self.input("u")

            def step(self, t, h):
                pass

        s.add("one", One).add("two", Two).connect("one.y[2]", "two.u", factor=3, offset=0.5)
        with cotwin.Simulation(s) as simulation:
            simulation.step()
            simulation.step()
            self.assertEqual(simulation["two.u"][0], 6.5)

    def test_events_change_values(self):
        s = arm(stop=0.03).event(0.01, "drive.tau_e[2]", 5)
        simulation = cotwin.Simulation(s)
        simulation.run_to(0.009)
        self.assertEqual(simulation["drive.tau_e[2]"][0], 0)
        simulation.run_to(0.02)
        self.assertEqual(simulation["drive.tau_e[2]"][0], 5)

    def test_recording_and_step_are_as_chosen(self):
        result = arm(stop=0.05, tick=5e-4, every=10).record("drive.q").run()
        self.assertEqual(result.run.ticks, 100)
        np.testing.assert_allclose(result["time"], np.arange(11) * 5e-3, atol=1e-15)
        self.assertEqual(result.recording.signals, ["drive.q"])

    def test_fmus_are_sources_by_their_file(self):
        text = cotwin.Scenario().add("plant", "vendor/plant.fmu", timeout=5).to_ssd()
        self.assertIn('source="vendor/plant.fmu?timeout=5"/>', text)


class Refused(Case):
    def test_what_does_not_fit_together(self):
        s = arm()
        with self.assertError("'drive'", "added twice"):
            s.add("drive")
        with self.assertError("no component 'robot'", "motion, compliance, drive"):
            s.connect("robot", "drive", "q")
        with self.assertError("'robot.q'", "component.variable"):
            s.connect("robot.q", "drive.q")
        with self.assertError("component 'x': no unit 'drive_trian'", "expected one of motion", "did you mean 'drive_train'?"):
            s.add("x", "drive_trian")
        with self.assertError("component 'x': no unit 'no_unit'"):
            s.add("x", "no_unit")
        with self.assertError("drive_2.K", "not finite"):
            s.add("drive_2", "drive_train", values={"K": np.nan})

    def test_values_of_connected_inputs(self):
        for given in ({"drive.tau_m": 3}, {"drive.tau_m[2]": 3}, {"compliance.q": 0}):
            with self.subTest(given), self.assertError("is connected to", "expected a variable without a connection"):
                cotwin.Simulation(arm(), set=given)
        simulation = cotwin.Simulation(arm())
        with self.assertError("drive.tau_m", "is fed by compliance.tau_m"):
            simulation["drive.tau_m"] = np.zeros(7)
        simulation["drive.tau_e"] = np.ones(7)

    def test_values_that_are_no_values(self):
        for value in (np.nan, [1, np.inf], object(), None, 1j, []):
            with self.subTest(value), self.assertError("x.v", "expected"):
                cotwin.Scenario().add("x", "motion", values={"v": value})
        masked = np.ma.MaskedArray([1.0, 2.0], mask=[False, True])
        for value in (masked, [masked, masked], ([1.0, 2.0], masked)):
            with self.assertError("x.v", "masked elements") as context:
                cotwin.Scenario().add("x", "motion", values={"v": value})
            self.assertIsInstance(context.error, ValueError)

    def test_units_and_variables_that_do_not_exist_are_named_by_the_library(self):
        with self.assertError("drive_trian", "drive_train"):
            cotwin.Simulation(cotwin.Scenario(robot="lwr4").add("drive", "drive_trian"))
        with self.assertError("nonsense"):
            cotwin.Simulation(cotwin.Scenario(robot="lwr4").add("drive", "drive_train", values={"nonsense": 1}))
        with self.assertError("arm", "q_e"):
            cotwin.Simulation(arm().connect("drive", "compliance", "q_e"))

    def test_files_that_are_no_scenarios(self):
        with self.assertError("none.ssd"):
            cotwin.Simulation(self.folder / "none.ssd")
        (self.folder / "bad.ssd").write_text("<ssd:System")
        with self.assertError("bad.ssd"):
            cotwin.Simulation(self.folder / "bad.ssd")
        example = SOURCE / "examples/02_free_motion_lwr4/twin.ssd"
        with self.assertError("set", "expected a dictionary"):
            cotwin.Simulation(example, set="drive.K=1")
        with self.assertError("nonsense"):
            cotwin.Simulation(example, set={"nonsense.K": 1})
        with self.assertError("stop"):
            cotwin.Simulation(example, stop=float("nan"))


if __name__ == "__main__":
    unittest.main()
