import math
import threading
import unittest

import numpy as np

import cotwin
from support import Case, Q0, arm


class Spring(cotwin.Unit):
    "A mass on a spring."

    def declare(self):
        self.parameter("k", si="N/m", start=100, min=0)
        self.parameter("m", si="kg", start=4, min=1e-3)
        self.input("f", si="N", description="force on the mass")
        self.state("x", si="m", start=0.1)
        self.state("v", si="m/s")
        self.output("position", si="m")

    def initialise(self, t):
        self.position = self.x

    def step(self, t, h):
        w = math.sqrt(self.k[0] / self.m[0])
        end, x, v = self.f / self.k, self.x - self.f / self.k, self.v.copy()
        self.x = end + x * math.cos(w * h) + v / w * math.sin(w * h)
        self.v = v * math.cos(w * h) - x * w * math.sin(w * h)
        self.position = self.x


class Works(Case):
    def test_a_unit_follows_its_closed_form(self):
        s = cotwin.Scenario(stop=1).add("spring", Spring, values={"x": 0.5})
        result = s.run()
        np.testing.assert_allclose(result["spring.position"], 0.5 * np.cos(5 * result["time"]), atol=1e-12)

    def test_a_unit_runs_from_a_saved_scenario(self):
        file = cotwin.Scenario(stop=0.1).add("spring", Spring).save(self.folder / "spring.ssd")
        with self.assertError("no such unit", "spring"):
            cotwin.Simulation(file)
        a = cotwin.run(file, units=[Spring])
        b = cotwin.run(file, units={"spring": lambda: Spring()})
        np.testing.assert_array_equal(a.recording.values, b.recording.values)

    def test_a_controller_in_python_moves_as_one_of_the_library(self):
        class Hold(cotwin.Unit):
            "Gravity compensation and a stiff spring to the start."

            def declare(self):
                self.input("theta", 7, si="rad")
                self.input("dtheta", 7, si="rad/s")
                self.output("tau_m", 7, si="N.m")
                self.robot = cotwin.Robot("lwr4")

            def initialise(self, t):
                self.step(t, 0)

            def step(self, t, h):
                self.tau_m = self.robot.gravity(Q0) - 200 * (self.theta - Q0) - 10 * self.dtheta

            restorable = False  # a Robot cannot be pickled

        s = cotwin.Scenario(robot="lwr4", stop=0.3, coupling="explicit")
        s.add("hold", Hold).add("drive", "drive_train", values={"q0": Q0})
        s.connect("drive", "hold", "theta dtheta").connect("hold", "drive", "tau_m")
        result = s.run()
        np.testing.assert_allclose(result["drive.q"][-1], Q0, atol=0.05)

    def test_a_unit_ends_the_run(self):
        class End(cotwin.Unit):
            def declare(self):
                self.output("y")

            def step(self, t, h):
                return t < 0.0045

        self.assertEqual(cotwin.Scenario(stop=1).add("end", End).run().reached, 0.006)

    def test_parameters_tunables_and_inputs_come_from_outside(self):
        simulation = cotwin.Simulation(cotwin.Scenario(stop=1).add("spring", Spring), set={"spring.k": 25})
        self.assertEqual(simulation["spring.k"][0], 25)
        simulation["spring.f"] = 2.5
        simulation.run_to(0.5)
        w = 2.5
        self.assertAlmostEqual(simulation["spring.x"][0], 0.1 + (0.1 - 0.1) * math.cos(w * 0.5), places=12)
        with self.assertError("component 'spring': k = -1 N/m", "expected >= 0"):
            cotwin.Simulation(cotwin.Scenario().add("spring", Spring, values={"k": -1})).start()

    def test_several_components_have_units_of_their_own(self):
        s = cotwin.Scenario(stop=0.1).add("a", Spring, values={"x": 0.5}).add("b", Spring, values={"x": -0.5})
        result = s.run()
        np.testing.assert_array_equal(result["a.position"], -result["b.position"])

    def test_attributes_beside_the_variables_are_restored_with_them(self):
        # With a tolerance, and in solved loops, the master repeats steps.
        class Count(cotwin.Unit):
            def declare(self):
                self.calls = 0
                self.input("u")
                self.output("y")

            def initialise(self, t):
                self.calls = 0
                self.y = 1

            def step(self, t, h):
                self.calls += 1
                self.y = 1 + 0.5 * self.u

        class Half(cotwin.Unit):
            def declare(self):
                self.input("u")
                self.output("y")

            def initialise(self, t):
                self.y = 0.5

            def step(self, t, h):
                self.y = 0.5 * self.u

        made = []

        def count():
            made.append(Count())
            return made[0]

        s = cotwin.Scenario(stop=0.02, coupling="implicit")
        s.add("count", Count).add("half", Half)
        s.connect("count", "half", {"y": "u"}).connect("half", "count", {"y": "u"})
        result = cotwin.run(s, units={"count": count})
        self.assertEqual(made[0].calls, 20)
        np.testing.assert_allclose(result["count.y"][-1], 1 / (1 - 0.25), rtol=1e-9)

    def test_a_step_beside_the_loop_runs_in_another_thread(self):
        threads = set()

        class Slow(cotwin.Unit):
            restorable = False

            def declare(self):
                self.output("y")

            def step(self, t, h):
                threads.add(threading.get_ident())
                self.y = self.y + 1

        result = cotwin.Scenario(stop=0.1).add("slow", Slow, period=10, beside=True, stage=0).run()
        self.assertEqual(result.reached, 0.1)
        self.assertNotIn(threading.get_ident(), threads)


class Refused(Case):
    def error_of(self, cls, *parts, run=True):
        with self.assertError(*parts) as caught:
            simulation = cotwin.Simulation(cotwin.Scenario(stop=0.01).add("unit", cls))
            if run:
                simulation.run()
        return caught.error

    def test_an_exception_in_a_step_names_the_component_and_keeps_its_cause(self):
        class Raises(cotwin.Unit):
            def declare(self):
                self.output("y")

            def step(self, t, h):
                raise ZeroDivisionError("of this test")

        error = self.error_of(Raises, "unit", "raises in Python", "ZeroDivisionError: of this test")
        self.assertIsInstance(error.__cause__, ZeroDivisionError)
        self.assertIn("test_unit.py", error.__cause__.__traceback__.tb_frame.f_code.co_filename)

    def test_after_an_exception_the_run_is_over(self):
        class Late(cotwin.Unit):
            def declare(self):
                self.output("y")

            def step(self, t, h):
                if t > 0.002:
                    raise RuntimeError("late")

        simulation = cotwin.Simulation(cotwin.Scenario(stop=0.01).add("unit", Late), results=self.folder)
        with self.assertError("late"):
            simulation.run()
        with self.assertError("the run has failed"):
            simulation.step()
        self.assertGreater(len(cotwin.Recording.load(self.folder)), 1)

    def test_exceptions_while_a_unit_is_made(self):
        class NoDeclare(cotwin.Unit):
            pass

        class BadInit(cotwin.Unit):
            def __init__(self):
                raise KeyError("init")

        class BadStart(cotwin.Unit):
            def declare(self):
                self.output("y")

            def initialise(self, t):
                raise OSError("no device")

        self.error_of(NoDeclare, "NotImplementedError", "declare", run=False)
        self.error_of(BadInit, "KeyError", "init", run=False)
        self.error_of(BadStart, "OSError: no device")
        with self.assertError("dict", "derived from cotwin.Unit"):
            cotwin.Simulation(cotwin.Scenario().add("unit", "unit:thing"), units={"thing": dict})

    def test_outputs_that_are_not_finite_end_the_run(self):
        class Nan(cotwin.Unit):
            def declare(self):
                self.output("y", 3)

            def step(self, t, h):
                self.y = [0, math.nan, 0]

        self.error_of(Nan, "unit.y[2]", "nan")

    def test_values_of_another_shape_are_refused(self):
        class Shape(cotwin.Unit):
            def declare(self):
                self.output("y", 3)

            def step(self, t, h):
                self.y = [1, 2]

        self.error_of(Shape, "Shape.y", "(2,)", "(3,)")

    def test_inputs_and_parameters_are_read_only(self):
        class Assigns(cotwin.Unit):
            def declare(self):
                self.input("u")

            def step(self, t, h):
                self.u = 1

        class Writes(cotwin.Unit):
            def declare(self):
                self.parameter("p")

            def step(self, t, h):
                self.p[0] = 1

        class Deletes(cotwin.Unit):
            def declare(self):
                self.state("x")

            def step(self, t, h):
                del self.x

        self.error_of(Assigns, "Assigns.u", "is an input")
        self.error_of(Writes, "read-only")
        self.error_of(Deletes, "Deletes.x", "cannot be deleted")

    def test_results_of_a_step_other_than_true_and_false(self):
        class Returns(cotwin.Unit):
            def declare(self):
                self.output("y")

            def step(self, t, h):
                return 1

        self.error_of(Returns, "returned 1", "None, True", "False")

    def test_declarations_that_make_no_sense(self):
        def declaring(action):
            class Bad(cotwin.Unit):
                def declare(self):
                    action(self)

                def step(self, t, h):
                    pass

            return Bad

        cases = (
            (lambda u: u.input("u", 0), "Bad.u", "size 0"),
            (lambda u: u.input("u", 2.5), "Bad.u", "size 2.5"),
            (lambda u: u.input("u", 2, start=[1, 2, 3]), "Bad.u", "one number or 2"),
            (lambda u: u.input("u", start="x"), "Bad.u", "start 'x'"),
            (lambda u: u.input("1u"), "Bad.1u", "letters"),
            (lambda u: u.input("step"), "Bad.step", "attribute of the class"),
            (lambda u: (u.input("u"), u.output("u")), "Bad.u", "declared twice"),
            (lambda u: u.input("u", si="furlong"), "furlong", ""),
            (lambda u: u.input("u", si="mm"), "u", "expected SI"),
        )
        for action, *parts in cases:
            with self.subTest(parts):
                self.error_of(declaring(action), *parts, run=False)

    def test_names_of_units(self):
        for name, part in (("motion", "already a unit of this name"), ("a b", "letters"), ("", "letters")):
            with self.subTest(name), self.assertError(part):
                cotwin.Simulation(cotwin.Scenario().add("x", "unit:motion"), units={name: Spring})
        with self.assertError("derived from cotwin.Unit"):
            cotwin.Simulation(arm(), units=[dict])
        with self.assertError("spring", "function that makes a unit"):
            cotwin.Simulation(arm(), units={"spring": 3})

    def test_attributes_that_cannot_be_saved_are_named(self):
        class Lock(cotwin.Unit):
            def declare(self):
                self.lock = threading.Lock()
                self.output("y")

            def step(self, t, h):
                pass

        self.error_of(Lock, "lock", "pickle", "restorable = False")

    def test_a_unit_cannot_use_its_own_run(self):
        class Inside(cotwin.Unit):
            def declare(self):
                self.output("y")

            def step(self, t, h):
                simulation.step()

        simulation = cotwin.Simulation(cotwin.Scenario(stop=0.01).add("unit", Inside))
        with self.assertError("unit of its own step"):
            simulation.run()


if __name__ == "__main__":
    unittest.main()
