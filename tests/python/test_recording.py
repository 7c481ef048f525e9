import pathlib
import unittest
import warnings

import numpy as np

import cotwin
from support import Case

try:
    import pandas
except ImportError:
    pandas = None


class Load(Case):
    def write(self, text, name="signals.csv"):
        (self.folder / name).write_bytes(text.encode())
        return self.folder / name

    def test_signals_are_vectors_or_scalars(self):
        r = cotwin.Recording.load(self.write('time,a.q[1],a.q[2],b.y\n0,1,2,3\n0.001,4,5,6\n'))
        self.assertEqual(r.signals, ["a.q", "b.y"])
        np.testing.assert_array_equal(r["a.q"], [[1, 2], [4, 5]])
        np.testing.assert_array_equal(r["a.q[2]"], [2, 5])
        np.testing.assert_array_equal(r["b.y"], [3, 6])
        np.testing.assert_array_equal(r.time, [0, 0.001])
        self.assertTrue(np.shares_memory(r["a.q"], r.values))
        self.assertEqual((len(r), list(r), "a.q" in r, "a.z" in r), (2, ["a.q", "b.y"], True, False))
        with self.assertError("'a.z'", "a.q, b.y"):
            r["a.z"]

    def test_units_and_joints_are_those_of_the_record_of_the_run(self):
        self.write(
            """{"recording": {"joint_names": true, "columns": [{"name": "time", "elements": 1, "unit": "s"},
               {"name": "a.q", "elements": 2, "unit": "", "units": ["rad", "m"], "joints": ["elbow", "a slide"]}]}}""",
            "run.json",
        )
        r = cotwin.Recording.load(self.write("time,a.q[elbow],a.q[a slide]\n0,1,2\n").parent)
        self.assertEqual(r.names, ["time", "a.q[1]", "a.q[2]"])
        self.assertEqual(r.units, {"time": "s", "a.q[1]": "rad", "a.q[2]": "m"})
        self.assertEqual(r.joints, {"a.q[1]": "elbow", "a.q[2]": "a slide"})
        np.testing.assert_array_equal(r["a.q"], [[1, 2]])
        if pandas is not None:
            self.assertEqual(r.to_pandas().attrs, {"units": r.units, "joints": r.joints})
        self.assertEqual(cotwin.Recording(["time"], np.zeros((1, 1))).units, {})

    def test_columns_that_are_no_neighbours_are_put_together(self):
        r = cotwin.Recording(["time", "q[1]", "y", "q[2]"], np.array([[0, 1, 9, 2.0]]))
        np.testing.assert_array_equal(r["q"], [[1, 2]])

    def test_a_file_that_is_cut_short_loses_its_last_row_with_a_warning(self):
        file = self.write("time,y\n0,1\n1,2\n2,3")
        with self.assertWarnsRegex(RuntimeWarning, "ends within a row"):
            r = cotwin.Recording.load(file)
        self.assertTrue(r.cut)
        np.testing.assert_array_equal(r["y"], [1, 2])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            for size in range(len("time,y\n"), len("time,y\n0,1\n1,2\n")):
                r = cotwin.Recording.load(self.write("time,y\n0,1\n1,2\n"[:size]))
                self.assertEqual(len(r), 0 if size < 11 else 1)

    def test_the_time_is_found_by_its_name_or_given(self):
        r = cotwin.Recording.load(self.write("q,Timestamp\n5,0\n6,1\n"))
        self.assertEqual(r.names, ["time", "q"])
        np.testing.assert_array_equal(r.values, [[0, 5], [1, 6]])
        file = self.write("time_ms,q\n0,5\n500,6\n")
        with self.assertError("'t', 'time' or 'timestamp'", "t_column"):
            cotwin.Recording.load(file)
        np.testing.assert_array_equal(cotwin.Recording.load(file, t_column="time_ms", time_unit="ms").time, [0, 0.5])
        with self.assertError("time_unit", "'h'", "s, ms, us, ns"):
            cotwin.Recording.load(file, t_column="time_ms", time_unit="h")

    def test_bags_are_read_as_tables(self):
        bag = pathlib.Path(__file__).parents[1] / "models/bag/files/jazzy.db3"
        r = cotwin.Recording.load(bag)
        self.assertEqual(r.names[:3], ["time", "position_arm", "position_lift"])
        np.testing.assert_array_equal(r["effort_arm"], 1 / (np.arange(60) + 1))
        np.testing.assert_array_equal(cotwin.Recording.load(bag, topic="/wrench")["force.y"], 20 * np.arange(6))
        with self.assertError("has no topic '/wrenches'", "/wrench (geometry_msgs/msg/WrenchStamped, 6 messages)"):
            cotwin.Recording.load(bag, topic="/wrenches")

    def test_the_part_of_a_killed_run_is_read(self):
        self.write("time,y\n0,1\n", "signals.csv.part")
        self.assertEqual(len(cotwin.Recording.load(self.folder)), 1)

    def test_not_a_number_is_a_number_of_a_recording(self):
        r = cotwin.Recording.load(self.write("time,y\n0,nan\n1,inf\n2,-inf\n"))
        self.assertTrue(np.isnan(r["y"][0]))
        self.assertEqual(r["y"][1:].tolist(), [np.inf, -np.inf])

    def test_markup_in_names_stays_a_name(self):
        r = cotwin.Recording.load(self.write('time,"<script>alert(1)</script>"\n0,1\n'))
        self.assertEqual(r.signals, ["<script>alert(1)</script>"])

    def test_damaged_files_are_errors_with_their_line(self):
        with self.assertError("signals.csv"):
            cotwin.Recording.load(self.folder)
        with self.assertError("signals.csv:3"):
            cotwin.Recording.load(self.write("time,y\n0,1\n1\n"))
        with self.assertError("signals.csv:2", "abc", "expected a number"):
            cotwin.Recording.load(self.write("time,y\n0,abc\n"))
        with self.assertError("signals.csv"):
            cotwin.Recording.load(self.write(""))
        with self.assertError("signals.csv"):
            cotwin.Recording.load(self.write("\0\0\0\0\n\0\n"))
        with self.assertError("(1, 2)", "(rows, 3)"):
            cotwin.Recording(["time", "a", "b"], np.zeros((1, 2)))
        with self.assertError("recording: values", "masked elements"):
            cotwin.Recording(["time", "a"], np.ma.MaskedArray(np.zeros((1, 2)), mask=[[False, True]]))
        with self.assertError("recording: values", "masked elements"):
            cotwin.Recording(["time", "a"], [np.ma.MaskedArray(np.zeros(2), mask=[False, True])])

    @unittest.skipIf(pandas is None, "pandas is missing (Debian: python3-pandas)")
    def test_a_frame_has_the_time_as_index_and_a_column_per_element(self):
        r = cotwin.Recording.load(self.write("time,a.q[1],a.q[2],b.y\n0,1,2,3\n0.5,4,5,6\n"))
        frame = r.to_pandas()
        self.assertEqual(list(frame.columns), ["a.q[1]", "a.q[2]", "b.y"])
        self.assertEqual(frame.index.name, "time")
        self.assertEqual(frame.loc[0.5, "a.q[2]"], 5)
        np.testing.assert_array_equal(frame.to_numpy(), r.values[:, 1:])


if __name__ == "__main__":
    unittest.main()
