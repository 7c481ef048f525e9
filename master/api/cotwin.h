#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "models/foundation/support/error.h"

/// \file
/// The public interface of Cotwin, installed as `cotwin/cotwin.h`: run a scenario, evaluate the dynamics of a robot, tune a robot to
/// measured torques, design exciting motions, ask the motion services. It is stable by promise: within a major version (before 1.0:
/// within a minor version) it is only extended. Other headers below `cotwin/` may change at any time.
///
/// Conventions: SI (m, kg, s, rad, N, N.m) everywhere; vectors of n elements in the order of the robot's joints (URDF, depth-first); the
/// base frame B is the URDF's root link. Every function throws cotwin::Error for what a caller or a file has wrong, with place, fact and
/// expectation in its message. An object is used by one thread at a time; different objects are independent.
///
/// \class cotwin::Error
/// The type of all exceptions of this library (`models/foundation/support/error.h`), a std::runtime_error.

#define COTWIN_API __attribute__((visibility("default")))

namespace cotwin {

/// The version of the library that is loaded, "0.1.0" (SemVer).
COTWIN_API std::string version();

// ---- Dynamics of a robot ---------------------------------------------------------------------------------------------------

/// A matrix by rows.
struct Matrix {
  std::size_t rows = 0;        ///< number of rows
  std::size_t columns = 0;     ///< number of columns
  std::vector<double> values;  ///< rows x columns; element (i, j) at [i * columns + j]

  /// Element of row i and column j, both counted from 0; not checked.
  double operator()(std::size_t i, std::size_t j) const { return values[i * columns + j]; }
};

/// Where a frame F stands in the base frame B.
struct FramePose {
  std::array<double, 9> R{};  ///< rotation R_BF by rows; its columns are the axes of F in B
  std::array<double, 3> p{};  ///< position p_BF of F's origin in B, m
};

/// An ellipsoid of velocities or accelerations of a frame, in the axes of B.
struct Ellipsoid {
  std::array<double, 9> axes{};     ///< by rows; its columns are the directions of the half-axes, longest first
  std::array<double, 3> lengths{};  ///< of the half-axes; +infinity where motors drive a joint that moves no mass
  std::array<double, 3> centre{};   ///< centre
  double measure = 0;               ///< product of the lengths: Yoshikawa's manipulability
};

/// Manipulability of a frame, translation and rotation apart.
struct Manipulability {
  Ellipsoid translation;  ///< m/s, or m/s^2 if dynamic
  Ellipsoid rotation;     ///< rad/s, or rad/s^2 if dynamic
};

/// The axes in which a direction is given.
enum class Axes : std::uint8_t {
  kBase,  ///< those of the base frame B
  kFrame  ///< those of the frame itself
};

/// A joint of one degree of freedom.
struct JointInfo {
  std::string name;        ///< of the URDF's joint
  bool prismatic = false;  ///< true: q in m, tau in N; false (revolute): q in rad, tau in N.m
  double q_min = 0;        ///< lower limit of q, rad or m; -infinity if there is none
  double q_max = 0;        ///< upper limit of q, rad or m; +infinity if there is none
  double dq_max = 0;       ///< largest speed, rad/s or m/s; +infinity if there is none
  double tau_max = 0;      ///< largest torque or force, N.m or N; +infinity if there is none
};

/// Kinematics and dynamics of a robot with rigid joints: M(q) ddq + C(q, dq) dq + g(q) = tau. Arguments are vectors of n()
/// elements; any other length is an Error. Results are new vectors.
class COTWIN_API Robot {
 public:
  /// Loads a URDF with revolute, continuous, prismatic and fixed joints. \param urdf a file, or the name of a robot that comes
  /// with Cotwin ("lwr4"). Throws Error for what is wrong with the file, with its line.
  explicit Robot(const std::string& urdf);
  ~Robot();
  /// Moves; the source may only be destroyed or assigned afterwards.
  Robot(Robot&&) noexcept;
  /// Moves; the source may only be destroyed or assigned afterwards.
  Robot& operator=(Robot&&) noexcept;

  /// Number of joints.
  std::size_t n() const;
  /// The n joints.
  std::vector<JointInfo> joints() const;
  /// Names of all frames: the URDF's links.
  std::vector<std::string> frames() const;

  /// M(q), n x n, symmetric; kg.m^2 between revolute joints, kg between prismatic ones, kg.m between one of each.
  /// \param q n, rad or m
  Matrix mass_matrix(std::span<const double> q);
  /// g(q), n, N.m or N. \param q n, rad or m
  std::vector<double> gravity(std::span<const double> q);
  /// C(q, dq) dq + g(q), n, N.m or N. \param q n, rad or m \param dq n, rad/s or m/s
  std::vector<double> bias(std::span<const double> q, std::span<const double> dq);
  /// tau = M ddq + C dq + g, n, N.m or N. \param q n, rad or m \param dq n, rad/s or m/s \param ddq n, rad/s^2 or m/s^2
  std::vector<double> inverse_dynamics(std::span<const double> q, std::span<const double> dq, std::span<const double> ddq);
  /// ddq = M^-1 (tau - C dq - g), n, rad/s^2 or m/s^2; not finite where a joint moves no mass. \param q n, rad or m
  /// \param dq n, rad/s or m/s \param tau n, N.m or N
  std::vector<double> forward_dynamics(std::span<const double> q, std::span<const double> dq, std::span<const double> tau);
  /// Pose of a frame in B. \param q n, rad or m \param frame a name of frames(); "": the end of the longest chain. Throws Error
  /// for an unknown frame.
  FramePose forward_kinematics(std::span<const double> q, const std::string& frame = "");
  /// J, 6 x n, with [v; w] = J dq: velocity v of the frame's origin (m/s) in rows 0 to 2 and angular velocity w (rad/s) in rows
  /// 3 to 5, both relative to B and expressed in B. Parameters and errors as forward_kinematics().
  Matrix jacobian(std::span<const double> q, const std::string& frame = "");

  /// Effective mass of a frame's origin along u, 1/(u' J_v M^-1 J_v' u), kg: a force f along u accelerates it along u by f over
  /// this mass, while all its other motions are free. +infinity along a direction in which the joints cannot move it (singular
  /// position). \param q n, rad or m \param u direction, of any length but zero \param frame as in forward_kinematics()
  /// \param axes those of u \param motor_inertia of the motors behind the gears, n, kg.m^2 or kg, not negative; it is added to
  /// M's diagonal (slow motions); +infinity: the joint is locked; empty: they are free (blows). Throws Error for u = 0 and wrong values.
  double effective_mass(std::span<const double> q, const std::array<double, 3>& u, const std::string& frame = "",
                        Axes axes = Axes::kBase, std::span<const double> motor_inertia = {});
  /// Effective inertia of a frame about u, 1/(u' J_w M^-1 J_w' u), kg.m^2: a moment about u over the angular acceleration about
  /// u. Parameters and errors as effective_mass().
  double effective_inertia(std::span<const double> q, const std::array<double, 3>& u, const std::string& frame = "",
                           Axes axes = Axes::kBase, std::span<const double> motor_inertia = {});
  /// Derivative of effective_mass() by q, with u fixed in its axes; n, kg/rad or kg/m; 0 where the mass is infinite. Parameters
  /// and errors as effective_mass().
  std::vector<double> effective_mass_gradient(std::span<const double> q, const std::array<double, 3>& u,
                                              const std::string& frame = "", Axes axes = Axes::kBase,
                                              std::span<const double> motor_inertia = {});
  /// Velocities of a frame for joint speeds of norm 1 (rad/s, m/s). \param q n, rad or m \param frame as in
  /// forward_kinematics()
  Manipulability manipulability(std::span<const double> q, const std::string& frame = "");
  /// Accelerations of a frame for motor torques whose quotients with tau_max have the norm 1, around those without motor
  /// torques (Yoshikawa 1985). \param q n, rad or m \param dq n, rad/s or m/s \param tau_max n, N.m or N, finite
  /// \param frame as in forward_kinematics() \param motor_inertia as in effective_mass(). Throws Error for wrong values.
  Manipulability dynamic_manipulability(std::span<const double> q, std::span<const double> dq, std::span<const double> tau_max,
                                        const std::string& frame = "", std::span<const double> motor_inertia = {});

  /// The links whose masses move with the joints, in the order of the parameters of regressor(): those of the n joints, then those
  /// of mimic joints.
  std::size_t bodies() const;
  /// pi, 10 bodies(): of each body its mass (kg), mass times centre of mass x, y, z (kg.m), and inertia xx, xy, xz, yy, yz, zz about
  /// the origin of its link's frame and in its axes (kg.m^2).
  std::vector<double> inertial_parameters() const;

  // Many states at once. Arrays are by rows: joint j of state s at [s n() + j]; the number of states follows from the length of q.
  // Results are written to the last argument, whose length must fit; it must not overlap another array. Nothing is allocated.

  /// M of each state at [s n^2]. \param q states x n, rad or m \param M states x n x n, as mass_matrix()
  void mass_matrix(std::span<const double> q, std::span<double> M);
  /// g of each state. \param q states x n, rad or m \param g states x n, N.m or N
  void gravity(std::span<const double> q, std::span<double> g);
  /// C dq + g of each state. \param q states x n, rad or m \param dq states x n, rad/s or m/s \param h states x n, N.m or N
  void bias(std::span<const double> q, std::span<const double> dq, std::span<double> h);
  /// C(q, dq) of each state, for which dM/dt - 2C is skew-symmetric. \param q states x n, rad or m \param dq states x n, rad/s or
  /// m/s \param C states x n x n, by rows
  void coriolis_matrix(std::span<const double> q, std::span<const double> dq, std::span<double> C);
  /// tau of each state. A state of many is computed in SIMD lanes and agrees with the same state alone to rounding. \param q states x
  /// n, rad or m \param dq states x n, rad/s or m/s \param ddq states x n, rad/s^2 or m/s^2 \param tau states x n, N.m or N
  void inverse_dynamics(std::span<const double> q, std::span<const double> dq, std::span<const double> ddq,
                        std::span<double> tau);
  /// The same with arrays by joints: joint j of state s at [j states + s]. This is the order in which the lanes are computed, and
  /// faster. \param q n x states, rad or m \param dq n x states, rad/s or m/s \param ddq n x states, rad/s^2 or m/s^2
  /// \param tau n x states, N.m or N
  void inverse_dynamics_by_joint(std::span<const double> q, std::span<const double> dq, std::span<const double> ddq,
                                 std::span<double> tau);
  /// ddq of each state. \param q states x n, rad or m \param dq states x n, rad/s or m/s \param tau states x n, N.m or N
  /// \param ddq states x n, rad/s^2 or m/s^2
  void forward_dynamics(std::span<const double> q, std::span<const double> dq, std::span<const double> tau,
                        std::span<double> ddq);
  /// Y of each state, with tau = Y pi of inertial_parameters(). \param q states x n, rad or m \param dq states x n, rad/s or m/s
  /// \param ddq states x n, rad/s^2 or m/s^2 \param Y states x n x 10 bodies(), by rows
  void regressor(std::span<const double> q, std::span<const double> dq, std::span<const double> ddq, std::span<double> Y);
  /// Pose of a frame in each state. \param q states x n, rad or m \param frame as above \param R states x 9, R_BF by rows
  /// \param p states x 3, p_BF, m
  void forward_kinematics(std::span<const double> q, const std::string& frame, std::span<double> R, std::span<double> p);
  /// J of each state. \param q states x n, rad or m \param frame as above \param J states x 6 x n, by rows, as jacobian()
  void jacobian(std::span<const double> q, const std::string& frame, std::span<double> J);
  // A base that moves freely, for example a satellite's (V-C), without momentum. It has the mass of the URDF's root link; Error if that
  // link has none.

  /// M* = M - F' I_c^-1 F of each state: M* ddq + C* dq = tau. \param q states x n, rad or m \param M states x n x n, as mass_matrix()
  void floating_mass_matrix(std::span<const double> q, std::span<double> M);
  /// J* of each state, the generalised Jacobian (Umetani and Yoshida 1989): as jacobian(), relative to an inertial frame; the base recoils.
  /// \param q states x n, rad or m \param frame as above \param J states x 6 x n, by rows
  void floating_jacobian(std::span<const double> q, const std::string& frame, std::span<double> J);
  /// Z of each state: Z dq is the angular velocity of the base in its own axes, rad/s. \param q states x n, rad or m
  /// \param Z states x 3 x n, by rows
  void floating_rotation(std::span<const double> q, std::span<double> Z);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// ---- Units of the calling program ------------------------------------------------------------------------------------------

/// A real variable of a ProgramUnit, in memory of the unit.
struct ProgramVariable {
  std::string role;          ///< "input", "output", "parameter", "tunable" or "state"
  std::string name;          ///< letters, digits, '_' and '.'; unique within the unit
  std::span<double> values;  ///< the elements; at first the start values. Address and length must not change
  std::string si;            ///< unit of measure, "N.m"; "1" for a pure number
  std::string description;   ///< one sentence
  double min = -std::numeric_limits<double>::infinity();  ///< lower bound of a parameter or input
  double max = std::numeric_limits<double>::infinity();   ///< upper bound
};

/// A co-simulation unit that the calling program implements, for prototypes. The order of calls is variables(), then any number of
/// initialise() and step(). An exception of a call ends the loading or the run. All calls are on the thread that loads or steps the
/// Simulation, except where the scenario steps the component beside the loop.
class ProgramUnit {
 public:
  virtual ~ProgramUnit() = default;
  /// The variables, once. Every value kept from step to step is a state, or passed by save() and restore().
  virtual std::vector<ProgramVariable> variables() = 0;
  /// Makes states and outputs agree with parameters and inputs; may be called repeatedly. \param t start time, s
  virtual void initialise(double t) = 0;
  /// Steps from t to t + h. Returns false if the run shall end after this step. \param t s \param h > 0, s
  virtual bool step(double t, double h) = 0;
  /// What steps remember outside of the variables, for a way back. \param bytes is replaced
  virtual void save(std::string& bytes) { bytes.clear(); }
  /// Takes back what save() returned, after the variables were written. \param bytes of save()
  virtual void restore(const std::string& bytes) { static_cast<void>(bytes); }
  /// False for a unit whose steps cannot be taken back.
  virtual bool restorable() const { return true; }
};

/// A kind of units of the calling program: a source `unit:NAME` of scenarios.
struct ProgramUnitType {
  std::string name;                                    ///< no name of another unit
  std::string summary;                                 ///< one sentence
  std::function<std::unique_ptr<ProgramUnit>()> make;  ///< called for each component with this source
};

// ---- Recordings ------------------------------------------------------------------------------------------------------------

/// A table of numbers over time.
struct Recording {
  std::vector<std::string> names;   ///< of the columns: "time", then "drive.q[1]", "drive.q[2]" …
  std::size_t rows = 0;             ///< number of rows
  std::vector<double> values;       ///< rows x names.size(), by rows; time in s, others in the variables' units of measure
  bool cut = false;                 ///< the file ends within a row, which was left out
  std::vector<std::string> units;   ///< of measure of each column; empty: they are not known
  std::vector<std::string> joints;  ///< names of the joints of columns, "" where there is none; empty: they are not known
};

/// Reads signals.csv (a run.json beside it tells units and joints), another CSV file with a header and a time, or a ROS 2 bag. \param t_column that of the time; empty: t, time or
/// timestamp. \param t_unit s per unit of it. \param topic of a bag; empty: the only one with joints. Throws Error, with file and line, for what is missing and cells that are no numbers.
COTWIN_API Recording load_recording(const std::filesystem::path& file, const std::string& t_column = "", double t_unit = 1,
                                    const std::string& topic = "");

// ---- Scenarios -------------------------------------------------------------------------------------------------------------

/// How a scenario is loaded.
struct SimulationOptions {
  /// Changes of the scenario as `cotwin run --set` takes them: "drive.K=2e4", "drive.friction=lugre", "robot=arm.urdf".
  std::vector<std::string> set;
  std::optional<double> stop;     ///< stop time instead of the scenario's, s
  std::filesystem::path results;  ///< folder for signals.csv, made if missing; files of an earlier run there move to its
                                  ///< subfolder earlier-1, earlier-2 …; empty: nothing is recorded
  std::vector<std::filesystem::path> units;    ///< modules with further units, as `cotwin run --units` takes them
  std::vector<std::filesystem::path> folders;  ///< where robots and scenes are looked up before the default folders
  std::optional<int> threads;                  ///< at most so many; results do not depend on them
  std::vector<ProgramUnitType> program_units;  ///< further units, of the calling program
  bool keep_rows = false;                      ///< keep the recorded rows in memory, for Simulation::recording()
};

/// A scenario in memory.
struct ScenarioText {
  std::string xml;                ///< as in an .ssd file
  std::string name = "scenario";  ///< in messages, in place of the file
  std::filesystem::path folder;   ///< relative references are looked up here; empty: the working directory
};

/// A variable of a component.
struct VariableInfo {
  std::string name;                ///< "drive.tau_J"
  std::string role;                ///< "input", "output", "parameter", "tunable" or "state"
  std::string kind;                ///< "real", "integer", "boolean" or "string"
  std::string si;                  ///< unit of measure of a real variable, "N.m"; empty where elements differ
  std::size_t size = 0;            ///< number of elements
  std::string description;         ///< meaning, in a sentence
  std::vector<std::string> units;  ///< of elements that differ; else empty
};

/// RMS and largest magnitude of a signal, over all ticks of a run.
struct Figure {
  std::string name;                ///< of the scenario's report, "joint torque"
  std::string signal;              ///< "drive.tau_J", "drive.q - motion.q_d"
  std::string si;                  ///< unit of measure of the figures; empty where elements differ
  std::vector<double> rms;         ///< per element
  std::vector<double> max;         ///< largest magnitude per element
  double total_rms = 0;            ///< over all elements; NaN where units differ
  double total_max = 0;            ///< over all elements; NaN where units differ
  std::vector<std::string> units;  ///< of elements that differ; else empty
};

/// What a run was like.
struct RunResult {
  double start = 0;                   ///< start time, s
  double reached = 0;                 ///< time at which the run ended, s
  double stop = 0;                    ///< stop time of the scenario, s
  std::int64_t ticks = 0;             ///< steps of the master
  double wall_seconds = 0;            ///< duration of the run, s
  std::vector<Figure> figures;        ///< what the scenario reports
  std::vector<std::string> warnings;  ///< sentences, each once
  std::filesystem::path recording;    ///< signals.csv; empty if nothing is recorded
  std::int64_t rows = 0;              ///< of the recording
};

/// A run of a scenario. Steps are deterministic: equal scenarios and equal values set at equal times give equal bits.
class COTWIN_API Simulation {
 public:
  /// Loads a scenario (.ssd or .ssp) with its units and FMUs. Throws Error for what is wrong with the scenario, with the line.
  explicit Simulation(const std::filesystem::path& scenario, const SimulationOptions& options = {});
  /// The same for a scenario in memory.
  explicit Simulation(const ScenarioText& scenario, const SimulationOptions& options = {});
  ~Simulation();
  /// Moves; the source may only be destroyed or assigned afterwards.
  Simulation(Simulation&&) noexcept;
  /// Moves; the source may only be destroyed or assigned afterwards.
  Simulation& operator=(Simulation&&) noexcept;

  /// All variables of all components.
  std::vector<VariableInfo> variables() const;

  /// Sets a real, integer or boolean (0, 1) variable: "drive.tau_e", or one element, "drive.tau_e[2]", counted from 1.
  /// Before start(): a parameter, a tunable, an input or a state that has a start value. Later: a tunable or an input that no
  /// connection feeds; the value holds from the next step on. \param name of the variable \param values one for each element,
  /// in the variable's unit of measure. Throws Error for an unknown name, another size or kind, a value out of range, and a
  /// variable that must not be set now; then nothing is changed.
  void set(std::string_view name, std::span<const double> values);
  /// Sets a variable, or an element, of size 1. As above. \param name of the variable \param value in its unit of measure
  void set(std::string_view name, double value);
  /// Sets a string parameter before start(). \param name of the variable \param value new value. Throws Error as above.
  void set_text(std::string_view name, const std::string& value);
  /// Values of a real, integer or boolean variable, or of one element, in its unit of measure; outputs are valid after start().
  /// \param name of the variable. Throws Error for an unknown name and for a string.
  std::vector<double> get(std::string_view name) const;
  /// The value of a string variable of size 1. \param name of the variable. Throws Error for an unknown name and other kinds.
  std::string get_text(std::string_view name) const;
  /// The memory of a real variable, or of one element, which has its present value after each step; to be read only while no step
  /// runs. It is valid as long as this object. \param name of the variable. Throws Error for an unknown name and other kinds.
  std::span<const double> view(std::string_view name) const;

  /// Initialises all components at the start time and opens the recording. step(), run_to() and run() do it if need be. Throws
  /// Error if the components cannot agree on their start values, and if it was called before.
  void start();
  /// Present time, s.
  double time() const;
  /// Steps the scenario by one tick. Returns false, and does nothing, at the stop time and after a component has ended the run.
  /// Throws Error for values that are not finite and steps that fail; then only result() may be called. With a clock it waits for
  /// its tick; after 0.1 s or a signal it returns true without one.
  bool step();
  /// Steps until time() is `t` or, between two ticks, the next tick after it. Returns false if the run ended before.
  /// \param t s. Throws Error as step() does.
  bool run_to(double t);
  /// Steps to the stop time, closes the recording and returns result(). Throws Error as step() does, and if that cannot be written.
  RunResult run();
  /// Ends the run at the present time: ends the units, writes the recording and closes it. Later steps do nothing. Throws Error if
  /// the recording cannot be written.
  void finish();
  /// The run so far.
  RunResult result() const;
  /// Stop time of the scenario, s.
  double stop() const;
  /// The rows so far, if SimulationOptions::keep_rows is set: columns and instants as in signals.csv. Throws Error if it is not.
  Recording recording() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// ---- Tuning ----------------------------------------------------------------------------------------------------------------

/// What is tuned to which log: the options of `cotwin tune`, which docs/tuning.md explains.
struct TuneOptions {
  std::string robot;                            ///< URDF, or the name of a robot that comes with Cotwin
  std::vector<std::filesystem::path> data;      ///< logs (CSV): t, q1…, tau1…, behind the gears, in SI
  std::vector<std::filesystem::path> held_out;  ///< logs that are only predicted; empty: the end of `data`
  std::filesystem::path out;                    ///< folder for the results, made if missing; files there are overwritten
  std::string method = "swarm";                 ///< "swarm", "feasible" or "least-squares"
  std::string friction = "sigmoid";             ///< "none", "coulomb", "sigmoid" or "stribeck"
  bool motor_torques = true;           ///< true: torques of the motors behind the gears; false: of joint torque sensors
  bool cross_validate = false;         ///< choose cutoff, load friction and prior weight within the training part
  double split = 0.7;                  ///< share of the data, from the first sample on, to train on, in (0, 1]
  double cutoff = 0;                   ///< low-pass, Hz; 0: chosen from the motion
  std::optional<double> prior_weight;  ///< weight of the URDF's parameters, dimensionless; empty: default of `cotwin tune`
  std::uint64_t seed = 1;              ///< equal seeds give equal bits
  int rounds = 500;                    ///< of the swarm, at most
  int threads = 1;                     ///< the result does not depend on them
  std::string q_columns;               ///< pattern of the position columns, "pos_{}"; "": q1, q2, …
  std::string dq_columns;              ///< of the velocities, "none" for none; "": dq1, dq2, … where there are any
  std::string tau_columns;             ///< of the torques; "": tau1, tau2, …
  /// Called on the calling thread with a phase and the share of it that is done, 0 to 1; may be empty.
  std::function<void(const std::string& what, double share)> progress;
  /// Called often, on any thread; true: end with the best result so far. May be empty.
  std::function<bool()> stop;
};

/// A parameter of unit:drive_train.
struct TunedParameter {
  std::string name;  ///< with the joint, counted from 1: "tau_C[2]"
  double value = 0;  ///< in `si`
  std::string si;    ///< unit of measure, "N.m"
};

/// What a tuning found.
struct TuneResult {
  std::filesystem::path robot;                ///< URDF with physically consistent inertias
  std::filesystem::path drive_train;          ///< .ssv with `parameters`
  std::filesystem::path report;               ///< report.md
  std::vector<TunedParameter> parameters;     ///< of the drives
  std::vector<double> training_rms;           ///< n, N.m or N: error of the predicted torques on the training part
  std::vector<double> held_out_rms;           ///< n, N.m or N: on the held-out part; empty if there is none
  std::vector<double> prior_held_out_rms;     ///< n, N.m or N: of the URDF as it was given
  std::vector<std::string> warnings;          ///< of robot, logs, motion and result
  std::vector<std::string> verdicts, alarms;  ///< a sentence per joint; what is wrong with the log, and bad verdicts
  bool interrupted = false;                   ///< by TuneOptions::stop during the search
};

/// Tunes a robot's inertias, friction and motors to measured torques. Writes the files of `cotwin tune` into options.out.
/// \param options robot, logs and method. Throws Error for what is wrong with options, robot or logs, and if TuneOptions::stop ended
/// it before the search; then nothing was written.
COTWIN_API TuneResult tune(const TuneOptions& options);

// ---- Exciting motions ------------------------------------------------------------------------------------------------------

/// A motion for the measurement of a robot's dynamics: the options of `cotwin excite`.
struct ExciteOptions {
  std::string robot;                        ///< URDF, or the name of a robot that comes with Cotwin
  double period = 10;                       ///< s
  int periods = 1;                          ///< of the samples
  double rate = 250;                        ///< samples per second; a whole number of at least 10 per period
  int harmonics = 5;                        ///< of the Fourier series of each joint
  double share = 0.9;                       ///< of every limit that the motion may use, in (0, 1]
  double ddq_max = 10;                      ///< acceleration limit of every joint, rad/s^2 or m/s^2
  std::optional<double> dq_max;             ///< further speed limit of every joint, rad/s or m/s
  std::vector<double> q_min;                ///< n, rad or m: lower limits, within those of the URDF; empty: those of the URDF
  std::vector<double> q_max;                ///< n, rad or m: upper limits, likewise
  std::string criterion = "condition";      ///< "condition" (least) or "determinant" (largest)
  std::uint64_t seed = 1;                   ///< equal seeds give equal bits
  int rounds = 150;                         ///< of the swarm
  int particles = 40;                       ///< of the swarm
  int threads = 1;                          ///< the result does not depend on them
  std::function<bool(int round)> progress;  ///< called after each round; false ends the search, with an Error. May be empty
};

/// An exciting motion: a Fourier series, sampled. At rest at both ends of each period.
struct ExcitingMotion {
  std::size_t joints = 0;             ///< n
  std::vector<double> t;              ///< samples, s
  std::vector<double> q;              ///< samples x n by rows, rad or m
  std::vector<double> dq;             ///< samples x n by rows, rad/s or m/s
  std::vector<double> ddq;            ///< samples x n by rows, rad/s^2 or m/s^2
  double condition = 0;               ///< condition number of the base regressor with columns of unit length
  int excited = 0;                    ///< base parameters that the motion excites
  int base = 0;                       ///< all base parameters
  std::vector<std::string> warnings;  ///< of the robot
};

/// Designs an exciting motion within the limits of the robot; it is not checked for collisions. \param options robot, limits and
/// search. Throws Error for what is wrong with them, and if the progress function ended the search.
COTWIN_API ExcitingMotion excite(const ExciteOptions& options);

// ---- Services --------------------------------------------------------------------------------------------------------------

/// What ask() may use.
struct AskOptions {
  std::string robot = "lwr4";  ///< of a request that names none: URDF, or the name of a robot that comes with Cotwin
  std::vector<std::filesystem::path> robots;  ///< folders with robots, in place of those of Cotwin
  int threads = 1;                            ///< of a search; the reply does not depend on them
  /// Called on the calling thread during a search with the share that is done, 0 to 1, at each percent; false ends the search, with
  /// an Error. May be empty.
  std::function<bool(double share, const std::string& message)> progress;
};

/// The names of the services: "feasibility", "energy" …
COTWIN_API std::vector<std::string> service_names();
/// The names of the library's own units: "drive_train".
COTWIN_API std::vector<std::string> unit_names();
/// The JSON Schemas of a service's request and reply, as JSON. \param service a name of service_names(). Throws Error for another one.
COTWIN_API std::string service_schema(const std::string& service);
/// Answers a question about a motion, as `cotwin ask` does (docs/services.md). The same request gives the same reply, byte for byte.
/// \param request a JSON object, {"service": "energy", "from_q_rad": […], "to_q_rad": […]} \param options robots and threads. Throws
/// Error with the JSON pointer of the member that is wrong.
COTWIN_API std::string ask(const std::string& request, const AskOptions& options = {});

}  // namespace cotwin
