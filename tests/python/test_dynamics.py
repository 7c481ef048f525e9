import math
import os
import pathlib
import pickle
import threading
import unittest

import numpy as np

import cotwin
from support import SOURCE, Case, Q0


def states(n, count, seed=1):
    random = np.random.default_rng(seed)
    return tuple(np.ascontiguousarray(random.uniform(-1, 1, (count, n))) for _ in range(3))


class Planar(Case):
    """planar2 is a double pendulum of cylinders: M, g, J in closed form."""

    def setUp(self):
        super().setUp()
        self.arm = cotwin.Robot("planar2")
        self.q = np.array([0.3, -0.7])

    def test_mass_matrix_and_gravity_are_those_of_the_closed_form(self):
        m1, m2, l1, l2, I1, I2, g = 6, 4, 0.4, 0.35, 0.08375, 0.0424333333, 9.81
        q1, q2 = self.q
        c = m2 * l1 * (l2 / 2) * math.cos(q2)
        inner = I2 + m2 * l2 * l2 / 4
        outer = I1 + m1 * l1 * l1 / 4 + m2 * l1 * l1 + inner + 2 * c
        expected = [[outer, inner + c], [inner + c, inner]]
        np.testing.assert_allclose(self.arm.mass_matrix(self.q), expected, rtol=0, atol=1e-12)
        g2 = m2 * g * l2 / 2 * math.cos(q1 + q2)
        g1 = (m1 * l1 / 2 + m2 * l1) * g * math.cos(q1) + g2
        np.testing.assert_allclose(self.arm.gravity(self.q), [g1, g2], rtol=0, atol=1e-11)

    def test_pose_and_jacobian_of_the_tip_are_those_of_the_closed_form(self):
        l1, l2 = 0.4, 0.35
        q1, q2 = self.q
        R, p = self.arm.forward_kinematics(self.q, "tip")
        self.assertAlmostEqual(p[2], 0.5 + l1 * math.sin(q1) + l2 * math.sin(q1 + q2), places=12)
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
        J = self.arm.jacobian(self.q, "tip")
        self.assertEqual(J.shape, (6, 2))
        self.assertAlmostEqual(J[0, 0], -l1 * math.sin(q1) - l2 * math.sin(q1 + q2), places=12)
        self.assertAlmostEqual(J[4, 0], -1, places=12)

    def test_effective_mass_is_that_of_the_closed_form(self):
        M, J = self.arm.mass_matrix(self.q), self.arm.jacobian(self.q, "tip")
        mobility = J[0] @ np.linalg.solve(M, J[0])
        self.assertAlmostEqual(self.arm.effective_mass(self.q, [3, 0, 0], "tip"), 1 / mobility, places=10)
        self.assertEqual(self.arm.effective_mass(self.q, [0, 1, 0], "tip"), math.inf)
        self.assertGreater(self.arm.effective_inertia(self.q, [0, 1, 0], "tip", "frame"), 0)
        self.assertEqual(self.arm.effective_mass_gradient(self.q, [1, 0, 0], "tip", motor_inertia=[1, 2]).shape, (2,))
        w = self.arm.manipulability(self.q, "tip")["translation"]["lengths"]
        self.assertAlmostEqual(w[0] * w[1], 0.4 * 0.35 * abs(math.sin(self.q[1])), places=12)
        self.assertEqual(self.arm.dynamic_manipulability(self.q, [0, 0], [150, 75])["rotation"]["axes"].shape, (3, 3))
        with self.assertError("axes", "'tool'", "base or frame"):
            self.arm.effective_mass(self.q, [1, 0, 0], "tip", "tool")
        with self.assertError("u", "(2,)", "(3,)"):
            self.arm.effective_mass(self.q, [1, 0])


class Lwr(Case):
    def setUp(self):
        super().setUp()
        self.arm = cotwin.Robot("lwr4")

    def test_a_robot_prints_its_joints_and_can_be_pickled(self):
        self.assertEqual(repr(cotwin.Robot("planar2")), "<cotwin.Robot 'planar2' with 2 joints: shoulder, elbow>")
        file = self.folder / "arm.urdf"
        file.write_text((SOURCE / "models/robots/lwr4/robot.urdf").read_text())
        for robot in (self.arm, cotwin.Robot(file), cotwin.Robot(os.path.relpath(file))):
            again = pickle.loads(pickle.dumps(robot))
            self.assertEqual(repr(again), repr(robot))
            np.testing.assert_array_equal(again.gravity(Q0), self.arm.gravity(Q0))
        file.unlink()
        with self.assertRaises(FileNotFoundError):
            pickle.loads(pickle.dumps(robot))

    def test_integers_are_numbers_and_masks_are_refused(self):
        zero = np.zeros(7)
        for kind in (int, np.int8, np.uint16):
            np.testing.assert_array_equal(self.arm.gravity(np.zeros(7, dtype=kind)), self.arm.gravity(zero))
        masked = np.ma.MaskedArray(zero, mask=[False] * 6 + [True])
        with self.assertError("q", "masked elements", "q.filled(value)") as context:
            self.arm.gravity(masked)
        self.assertIsInstance(context.error, ValueError)
        np.testing.assert_array_equal(self.arm.gravity(np.ma.MaskedArray(zero)), self.arm.gravity(zero))

    def test_errors_are_also_of_python_s_own_kinds(self):
        with self.assertRaises(ValueError) as shape:
            self.arm.gravity(np.zeros(6))
        self.assertIsInstance(shape.exception, cotwin.Error)
        with self.assertRaises(FileNotFoundError) as missing:
            cotwin.Robot(self.folder / "none.urdf")
        self.assertIsInstance(missing.exception, cotwin.Error)
        self.assertIn("none.urdf", str(missing.exception))
        with self.assertRaises(FileNotFoundError):
            cotwin.Robot("lwr")
        with self.assertRaises(KeyError):
            self.arm.forward_kinematics(Q0, frame="lnk_7")
        broken = self.folder / "broken.urdf"
        broken.write_text("<robot")
        with self.assertRaises(cotwin.Error) as error:
            cotwin.Robot(broken)
        self.assertNotIsInstance(error.exception, FileNotFoundError)

    def test_many_states_give_what_single_states_give(self):
        q, dq, ddq = states(7, 200)
        arm = self.arm
        kernels = {
            "mass_matrix": (q,),
            "gravity": (q,),
            "bias": (q, dq),
            "coriolis_matrix": (q, dq),
            "forward_dynamics": (q, dq, ddq),
            "regressor": (q, dq, ddq),
            "jacobian": (q,),
            "floating_mass_matrix": (q,),
            "floating_jacobian": (q,),
            "floating_rotation": (q,),
        }
        for name, arguments in kernels.items():
            with self.subTest(name):
                function = getattr(arm, name)
                all_of_them = function(*arguments)
                for s in (0, 7, 199):
                    np.testing.assert_array_equal(all_of_them[s], function(*(a[s] for a in arguments)))
        R, p = arm.forward_kinematics(q)
        for s in (0, 199):
            np.testing.assert_array_equal(R[s], arm.forward_kinematics(q[s])[0])
            np.testing.assert_array_equal(p[s], arm.forward_kinematics(q[s])[1])

    def test_inverse_dynamics_of_many_states_agrees_with_single_states_to_rounding(self):
        for count in (1, 7, 8, 129, 5000):
            with self.subTest(count):
                q, dq, ddq = states(7, count)
                tau = self.arm.inverse_dynamics(q, dq, ddq)
                self.assertEqual(tau.shape, (count, 7))
                for s in {0, count // 2, count - 1}:
                    np.testing.assert_allclose(tau[s], self.arm.inverse_dynamics(q[s], dq[s], ddq[s]), rtol=1e-11, atol=1e-11)

    def test_arrays_by_joint_give_the_same(self):
        q, dq, ddq = states(7, 1001)
        by_joint = [np.ascontiguousarray(a.T) for a in (q, dq, ddq)]
        out = np.empty((7, 1001))
        result = self.arm.inverse_dynamics(*by_joint, by_joint=True, out=out)
        self.assertIs(result, out)
        np.testing.assert_allclose(out.T, self.arm.inverse_dynamics(q, dq, ddq), rtol=1e-12, atol=1e-12)
        with self.assertError("q", "(1001, 7)", "(7, states)"):
            self.arm.inverse_dynamics(q, dq, ddq, by_joint=True)

    def test_forward_dynamics_is_the_inverse_of_inverse_dynamics(self):
        q, dq, ddq = states(7, 50)
        tau = self.arm.inverse_dynamics(q, dq, ddq)
        np.testing.assert_allclose(self.arm.forward_dynamics(q, dq, tau), ddq, atol=1e-9)

    def test_terms_add_up_to_inverse_dynamics(self):
        q, dq, ddq = (a[0] for a in states(7, 1))
        arm = self.arm
        tau = arm.inverse_dynamics(q, dq, ddq)
        np.testing.assert_allclose(arm.mass_matrix(q) @ ddq + arm.bias(q, dq), tau, atol=1e-12)
        np.testing.assert_allclose(arm.coriolis_matrix(q, dq) @ dq + arm.gravity(q), arm.bias(q, dq), atol=1e-12)
        np.testing.assert_allclose(arm.regressor(q, dq, ddq) @ arm.inertial_parameters(), tau, atol=1e-11)

    def test_coriolis_matrix_makes_the_rate_of_mass_minus_twice_itself_skew(self):
        q, dq, _ = (a[0] for a in states(7, 1))
        h = 1e-6
        rate = (self.arm.mass_matrix(q + h * dq) - self.arm.mass_matrix(q - h * dq)) / (2 * h)
        skew = rate - 2 * self.arm.coriolis_matrix(q, dq)
        np.testing.assert_allclose(skew, -skew.T, atol=1e-8)

    def test_results_are_written_to_out_without_a_copy(self):
        q, dq, ddq = states(7, 100)
        out = np.full((100, 7), np.nan)
        self.assertIs(self.arm.inverse_dynamics(q, dq, ddq, out=out), out)
        np.testing.assert_array_equal(out, self.arm.inverse_dynamics(q, dq, ddq))
        R, p = np.empty((100, 3, 3)), np.empty((100, 3))
        pose = self.arm.forward_kinematics(q, out=(R, p))
        self.assertIs(pose[0], R)
        self.assertIs(pose[1], p)
        half = np.zeros((200, 7))
        self.assertIs(self.arm.gravity(q, out=half[100:]).base, half)
        self.assertTrue(np.all(half[:100] == 0))

    def test_a_free_base_turns_as_in_the_reference(self):
        satellite = cotwin.Robot(pathlib.Path(SOURCE) / "examples/21_reaction/satellite.urdf")
        q = np.array([0, 0.5, 0, -1, 0, 1, 0.0])
        Z = satellite.floating_rotation(q)
        np.testing.assert_allclose(
            Z[2], [-0.410597, 0.020106, -0.223520, -0.013675, -0.006581, 0.000136, 0.000088], atol=5e-7
        )
        np.testing.assert_allclose(np.linalg.svd(Z)[1], [0.54322, 0.495085, 0.041228], atol=5e-6)
        # J* less the fixed Jacobian is the motion of the base, of which the rotation is Z; M* is M less what the base takes up.
        J = satellite.floating_jacobian(q, "link_7") - satellite.jacobian(q, "link_7")
        np.testing.assert_allclose(J[3:], Z, atol=1e-14)
        less = satellite.mass_matrix(q) - satellite.floating_mass_matrix(q)
        self.assertEqual(np.linalg.matrix_rank(less, 1e-9), 6)
        self.assertGreater(np.linalg.eigvalsh(less)[1:].min(), 0)
        out = np.empty((1, 3, 7))
        self.assertIs(satellite.floating_rotation(q[None], out=out), out)
        np.testing.assert_array_equal(out[0], Z)
        with self.assertError("planar2", "cannot float: mass 0 kg"):
            cotwin.Robot("planar2").floating_rotation(np.zeros(2))

    def test_empty_batch_gives_empty_results(self):
        none = np.empty((0, 7))
        self.assertEqual(self.arm.inverse_dynamics(none, none, none).shape, (0, 7))
        self.assertEqual(self.arm.mass_matrix(none).shape, (0, 7, 7))
        self.assertEqual(self.arm.jacobian(none).shape, (0, 6, 7))
        empty = np.empty((7, 0))
        self.assertEqual(self.arm.inverse_dynamics(empty, empty, empty, by_joint=True).shape, (7, 0))

    def test_nan_stays_in_its_state(self):
        q, dq, ddq = states(7, 100)
        clean = self.arm.inverse_dynamics(q, dq, ddq)
        q[42, 3] = np.nan
        tau = self.arm.inverse_dynamics(q, dq, ddq)
        self.assertTrue(np.any(np.isnan(tau[42])))
        # States in the same register take another way to their sines: equal to rounding.
        np.testing.assert_allclose(np.delete(tau, 42, 0), np.delete(clean, 42, 0), rtol=0, atol=1e-13)

    def test_lists_are_converted_and_other_arrays_refused(self):
        np.testing.assert_array_equal(self.arm.gravity(Q0.tolist()), self.arm.gravity(Q0))
        with self.assertError("q", "float32", "float64", "numpy.ascontiguousarray"):
            self.arm.gravity(Q0.astype(np.float32))
        with self.assertError("q", "bool"):
            self.arm.gravity(np.zeros(7, dtype=bool))
        with self.assertError("q", "complex128"):
            self.arm.gravity(Q0 * 1j)
        with self.assertError("q", ">f8"):
            self.arm.gravity(Q0.astype(">f8"))
        with self.assertError("q", "not C-contiguous"):
            self.arm.gravity(np.zeros((5, 14))[:, ::2])
        with self.assertError("q", "not C-contiguous"):
            self.arm.gravity(np.asfortranarray(np.zeros((5, 7))))
        raw = np.zeros(7 * 8 + 1, dtype=np.uint8)[1:].view(np.float64)
        with self.assertError("q", "not aligned"):
            self.arm.gravity(raw)
        for nonsense in ("abc", None, object(), [[1], [1, 2]], ["a"] * 7):
            with self.subTest(nonsense), self.assertError("q", "expected"):
                self.arm.gravity(nonsense)

    def test_wrong_shapes_are_refused_with_the_expected_one(self):
        with self.assertError("q", "(6,)", "(7,) or (states, 7)"):
            self.arm.gravity(np.zeros(6))
        with self.assertError("q", "(7, 5)"):
            self.arm.gravity(np.zeros((7, 5)))
        with self.assertError("q", "()"):
            self.arm.gravity(3.0)
        with self.assertError("q", "(2, 2, 7)"):
            self.arm.gravity(np.zeros((2, 2, 7)))
        with self.assertError("dq", "(3, 7)", "that of q", "(4, 7)"):
            self.arm.bias(np.zeros((4, 7)), np.zeros((3, 7)))
        with self.assertError("out", "(3, 7)", "(4, 7)"):
            self.arm.gravity(np.zeros((4, 7)), out=np.zeros((3, 7)))
        with self.assertError("out", "float32"):
            self.arm.gravity(Q0, out=np.zeros(7, dtype=np.float32))
        read_only = np.zeros(7)
        read_only.flags.writeable = False
        with self.assertError("out", "read-only"):
            self.arm.gravity(Q0, out=read_only)
        with self.assertError("out", "list"):
            self.arm.gravity(Q0, out=[0.0] * 7)
        with self.assertError("out", "(R, p)"):
            self.arm.forward_kinematics(Q0, out=np.zeros((3, 3)))

    def test_out_that_overlaps_an_argument_is_refused(self):
        both = np.zeros((20, 7))
        with self.assertError("out", "overlaps q"):
            self.arm.gravity(both, out=both)
        with self.assertError("out", "overlaps dq"):
            self.arm.bias(np.zeros((10, 7)), both[:10], out=both[5:15])
        self.arm.gravity(both[:10], out=both[10:])

    def test_unknown_frames_and_robots_are_errors_with_their_name(self):
        with self.assertError("link_77"):
            self.arm.jacobian(Q0, "link_77")
        with self.assertError("nonsense", "URDF"):
            cotwin.Robot("nonsense")
        with self.assertError("no_such.urdf"):
            cotwin.Robot(pathlib.Path("no_such.urdf"))

    def test_joints_have_names_and_limits(self):
        self.assertEqual(self.arm.n, 7)
        self.assertEqual(len(self.arm.joints), 7)
        self.assertFalse(self.arm.joints[0].prismatic)
        self.assertLess(self.arm.joints[0].q_min, self.arm.joints[0].q_max)
        self.assertIn("link_7", self.arm.frames)

    def test_threads_may_share_a_robot(self):
        q, dq, ddq = states(7, 20000)
        expected = self.arm.inverse_dynamics(q, dq, ddq)
        results = [None] * 4

        def work(i):
            for _ in range(5):
                results[i] = self.arm.inverse_dynamics(q, dq, ddq)
                self.arm.gravity(Q0)

        threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for result in results:
            np.testing.assert_array_equal(result, expected)


if __name__ == "__main__":
    unittest.main()
