import json
import subprocess
import unittest

import numpy as np

import cotwin
from support import PROGRAM, Case, Q0, Q1


class Ask(Case):
    def test_replies_are_those_of_the_program(self):
        reply = cotwin.ask({"service": "energy", "robot": "lwr4", "from_q_rad": Q0, "to_q_rad": Q1, "T_s": 2.0})
        command = [PROGRAM, "ask", "energy", "--robot", "lwr4", "--from", ",".join(map(repr, Q0.tolist()))]
        command += ["--to", ",".join(map(repr, Q1.tolist())), "--duration", "2"]
        done = subprocess.run(command, check=True, capture_output=True, text=True, cwd=self.folder)
        self.assertEqual(reply, json.loads(done.stdout))

    def test_every_service_has_a_schema(self):
        self.assertIn("feasibility", cotwin.service_names())
        for name in cotwin.service_names():
            schema = cotwin.service_schema(name)
            self.assertIn("request", schema)
            self.assertIn("reply", schema)

    def test_progress_is_told_and_ends_a_search(self):
        request = {"service": "optimise", "from_q_rad": Q0, "to_q_rad": Q1, "T_min_s": 2.0, "rounds": 20, "particles": 20}
        told = []
        first = cotwin.ask(request, threads=2, progress=lambda share, text: told.append((share, text)))
        self.assertTrue(told)
        self.assertTrue(all(0 <= share <= 1 for share, _ in told))
        self.assertEqual(first, cotwin.ask(request, threads=1))
        with self.assertError("stopped by its progress function"):
            cotwin.ask(request, progress=lambda share, text: False)

        def raises(share, text):
            raise ZeroDivisionError("of this test")

        with self.assertRaisesRegex(ZeroDivisionError, "of this test"):
            cotwin.ask(request, progress=raises)

    def test_grows_motions_between_arrays(self):
        request = {"service": "grow", "from_q_rad": Q0, "to_postures": [{"q_rad": Q1}, {"q_rad": 0.5 * Q1}], "T_min_s": 2.0, "T_max_s": 4.0}
        reply = cotwin.ask({**request, "motions": 2000}, threads=2)
        self.assertEqual(reply["motions"], 2000)
        self.assertEqual(len(reply["goals"]["time_s"]), 2)
        self.assertEqual(reply, cotwin.ask({**request, "motions": 2000}))

    def test_verification_runs_the_twin(self):
        reply = cotwin.ask({"service": "verify", "from_q_rad": Q0, "to_q_rad": Q0 + 0.2, "T_s": 1.0})
        self.assertTrue(reply["feasible"])

    def test_requests_that_make_no_sense_are_errors_with_their_place(self):
        for request, part in (
            ({}, "service"),
            ({"service": "nonsense"}, "nonsense"),
            ({"service": "energy", "from_q_rad": [1], "to_q_rad": Q1}, "from_q_rad"),
            ({"service": "energy", "from_q_rad": Q0, "to_q_rad": Q1, "T": 1}, "/T"),
            ({"service": "energy", "from_q_rad": Q0 * np.nan, "to_q_rad": Q1}, "request"),
            ({"service": "energy", "from_q_rad": object(), "to_q_rad": Q1}, "object"),
            ({"service": "energy", "robot": "../../etc/passwd", "from_q_rad": Q0, "to_q_rad": Q1}, "/robot"),
            ({"service": "energy", "from_q_rad": np.ma.MaskedArray(Q0, mask=Q0 == 0), "to_q_rad": Q1}, "request: has masked"),
            ({1j: 2}, "request"),
        ):
            with self.subTest(request), self.assertError(part):
                cotwin.ask(request)
        deep = {"service": "energy"}
        for _ in range(100):
            deep = {"service": deep}
        with self.assertError("32"):
            cotwin.ask(deep)
        with self.assertError("threads"):
            cotwin.ask({"service": "energy"}, threads=0)
        with self.assertError("none", "folder"):
            cotwin.ask({"service": "energy"}, robots=[self.folder / "none"])
        for missing in ({"robot": "none.urdf"}, {"robot": "lwr4", "data": "none.csv"}):
            with self.assertRaises(FileNotFoundError):
                cotwin.tune(**{"data": "log.csv", "out": self.folder, **missing})


class Excite(Case):
    def test_gives_the_samples_that_the_program_writes(self):
        motion = cotwin.excite("planar2", period=4, rate=50, periods=2, rounds=5, particles=10, seed=3)
        command = [PROGRAM, "excite", "--robot", "planar2", "--period", "4", "--rate", "50", "--periods", "2", "--rounds", "5"]
        command += ["--particles", "10", "--seed", "3", "--out", self.folder / "motion.csv", "--quiet"]
        subprocess.run(command, check=True, capture_output=True, cwd=self.folder)
        table = cotwin.Recording.load(self.folder / "motion.csv").values
        np.testing.assert_array_equal(np.column_stack([motion.t, motion.q, motion.dq, motion.ddq]), table)
        self.assertEqual(motion.q.shape, (401, 2))
        self.assertEqual(motion.excited, motion.base)
        self.assertGreater(motion.condition, 1)
        np.testing.assert_allclose(motion.dq[[0, 200, 400]], 0, atol=1e-12)

    def test_options_that_make_no_sense(self):
        with self.assertError("nonsense"):
            cotwin.excite("nonsense")
        with self.assertError("rate", "samples a period"):
            cotwin.excite("planar2", rate=0.1)
        with self.assertError("period -1", "expected a positive number"):
            cotwin.excite("planar2", period=-1)
        with self.assertError("periods"):
            cotwin.excite("planar2", periods=0)
        with self.assertError("criterion", "condition, determinant"):
            cotwin.excite("planar2", criterion="best")
        with self.assertError("'harmonic'", "harmonics"):
            cotwin.excite("planar2", harmonic=3)
        with self.assertError("'harmonics'", "type"):
            cotwin.excite("planar2", harmonics="three")
        with self.assertError("threads"):
            cotwin.excite("planar2", threads=0)
        with self.assertError("stopped"):
            cotwin.excite("planar2", rounds=1000, progress=lambda n: n < 2)


class Tune(Case):
    def log(self):
        arm = cotwin.Robot("planar2")
        t = np.arange(3000) * 5e-3
        q, dq, ddq = (np.zeros((t.size, 2)) for _ in range(3))
        for j in range(2):
            for k in range(1, 4):
                w, a, phase = 1.3 * k + 0.37 * j, 0.4 / k, 0.9 * k * (j + 1)
                q[:, j] += a * np.sin(w * t + phase)
                dq[:, j] += a * w * np.cos(w * t + phase)
                ddq[:, j] -= a * w * w * np.sin(w * t + phase)
        tau = arm.inverse_dynamics(q, dq, ddq)
        file = self.folder / "log.csv"
        header = "t,q1,q2,tau1,tau2"
        np.savetxt(file, np.column_stack([t, q, tau]), fmt="%.17g", delimiter=",", header=header, comments="")
        return file

    def test_finds_the_robot_that_made_the_log(self):
        told = []
        result = cotwin.tune(
            "planar2",
            self.log(),
            self.folder / "tuned",
            method="feasible",
            friction="coulomb",
            motor_torques=False,
            progress=lambda what, share: told.append(what),
        )
        self.assertEqual(result.held_out_rms.shape, (2,))
        self.assertLess(np.max(result.held_out_rms), 0.02)
        self.assertEqual(cotwin.Robot(str(result.robot)).n, 2)
        self.assertTrue(result.report.exists())
        self.assertTrue(result.parameters)
        self.assertFalse(result.interrupted)
        self.assertTrue(told)

    def test_the_progress_function_ends_a_search(self):
        log = self.log()
        with self.assertError("stopped before the search"):
            cotwin.tune("planar2", log, self.folder / "none", progress=lambda what, share: False)
        self.assertFalse((self.folder / "none/robot.urdf").exists())

    def test_options_that_make_no_sense(self):
        with self.assertError("none.csv"):
            cotwin.tune("planar2", self.folder / "none.csv", self.folder / "out")
        with self.assertError("'rouns'", "rounds"):
            cotwin.tune("planar2", "log.csv", self.folder / "out", rouns=3)
        with self.assertError("magic"):
            cotwin.tune("planar2", self.log(), self.folder / "out", method="magic")


if __name__ == "__main__":
    unittest.main()
