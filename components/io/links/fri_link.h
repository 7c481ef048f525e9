#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "components/io/fri/client.h"
#include "components/io/link/acknowledgement.h"
#include "components/io/link/belief.h"
#include "components/io/link/datagram_queue.h"
#include "components/io/link/fri_values.h"
#include "components/io/link/link.h"
#include "components/io/link/robot_kinematics.h"
#include "components/io/links/gain_check.h"
#include "components/io/links/synchronisation.h"
#include "components/unit/settings.h"
#include "models/trajectory/axes.h"

namespace cotwin::io {

/// A robot behind KUKA's FRI (LWR 4+ or Sunrise): the PC's side. A step takes the messages that have come, answers each, and gives
/// the newest measurements:
///   q, τ, τ_e   as reported, if they are believed (belief.h)
///   q̇          differences of q between messages over their send period, low-pass `dq_cutoff`;  q̈: differences of q̇
///   command     monitoring: mirrors what the robot commands; commanding: q_command with the PD synchronisation
///               (synchronisation.h), and by `mode` an overlaid torque or wrench, stiffness and damping
/// Commands begin when three messages in a row say that the robot takes them. Where one says that it does not, they come to rest at once, and have
/// ended when three in a row say so.
/// A robot that sends nothing that is believed for `timeout` is not connected: q and τ are held, q̇, q̈ and τ_e are 0, nothing is sent. After that, after
/// a restart of its controller (fri::ClientStatistics::sessions), a jump of its position, or when it does not take commands any more,
/// it is not commanded until the input `acknowledge` rises (acknowledgement.h): its own position is mirrored or, where it takes
/// commands, the position that it gives as commanded, or else as measured, is held. Commands then begin there. Where they begin is judged by BelievedSetPoint.
/// Inputs that are not finite, or beyond fri::kLargestNumber, are not sent: their last usable values are (`refused`).
/// If the robot does not ask for the quantity of `mode`, its position is held and `commanding` is false.
/// A clock that waits for the robot's next message without a limit sends the last answer again after kRepeat, because the answer or
/// the message may be lost, until nothing has come for `timeout` on the host's clock; end() sends it kLastTimes more: the robot
/// counts duplicates.
class FriLink final : public Link {
 public:
  FriLink(Settings& settings, std::vector<trajectory::Axis> joints);

  void declare(Variables& v, JointVariables& joints) override;
  void initialise(Time start, Measured& measured) override;
  StepResult step(Time now, Duration h, const Command& command, Measured& measured) override;
  bool restorable() const override { return false; }
  TickSource* tick_source() override { return &datagrams_; }
  Needs needs() const override;
  void append_notes(std::vector<std::string>& sentences) const override;
  void end() noexcept override;

 private:
  enum class Mode : std::uint8_t { kMonitor, kPosition, kTorque, kWrench, kJointImpedance, kCartesianImpedance };

  class Datagrams final : public DatagramQueue {
   public:
    explicit Datagrams(FriLink& link) : link_(link) {}
    std::optional<Arrival> wait(std::int64_t deadline) override;
    void set_waits(bool waits) override { waits_ = waits; }
    bool waits() const { return waits_; }

   private:
    bool repeats() const;

    FriLink& link_;
    bool waits_ = false;  // ticks wait without a limit
  };
  /// The values of the inputs, or the last usable ones.
  struct Inputs {
    explicit Inputs(std::size_t n) : q(n), tau(n) {}
    std::vector<double> q, tau;
    std::array<double, 6> F{};
    std::array<double, 3> p{};
    std::array<double, 4> quat{1, 0, 0, 0};
    bool has_place = false;  // a usable q, or p and quat, was there
  };
  /// What numbers_ has: five states, X_measured, reals, integers and bits of the robot's program.
  static constexpr std::size_t kState = 0, kQuality = 1, kSafety = 2, kCommandMode = 3, kControl = 4, kPose = 5,
                               kReal = kPose + 12, kInteger = kReal + 16, kBoolean = kInteger + 16;
  /// What came while the initialisation waited, for its error.
  struct Heard {
    std::uint64_t refused = 0;
    net::Endpoint from;  // of the first refused one, like what follows
    std::string why;
  };

  bool drives() const { return mode_ != Mode::kMonitor; }
  void open(Measured& measured);
  void check_gains() const;
  void wait_for_robot(Time start, Measured& measured);
  void note_refused(const DatagramQueue::Datagram& datagram);
  bool read_inputs(const Command& command);
  std::uint32_t quantity() const;
  bool may_follow() const;
  std::optional<DatagramQueue::Stamp> stamp(std::span<const std::uint8_t> bytes);
  bool take(const DatagramQueue::Datagram& datagram, std::int64_t arrival, std::int64_t now);
  std::int64_t repetition() const;
  void begin_session();
  void forget();
  bool is_believed();
  void add_numbers();
  void read_torques();
  void read_others();
  void examine_set_point(double elapsed);
  bool robot_ready() const;
  void demand_acknowledgement() {
    if (drives()) acknowledgement_.demand();
  }
  void choose_command();
  void follow(double elapsed);
  void measure(Measured& measured);
  void note_loss(Measured& measured);
  void write_outputs(std::int64_t now);

  fri::Protocol protocol_;
  std::size_t n_;
  Mode mode_ = Mode::kMonitor;
  Datagrams datagrams_;
  std::optional<fri::Client> client_;
  Synchronisation synchronisation_;
  GainCheck gains_{150};
  Acknowledgement acknowledgement_;
  Belief belief_;
  BelievedTorques tau_, tau_external_, F_external_;  // the force by its joint torques
  BelievedSetPoint set_point_, pose_;
  BelievedNumbers numbers_;                    // states, X_measured, variables of the robot's program
  ConfirmedState takes_;                       // the robot, commands: 0 none, else 1 + what it asks for
  std::optional<RobotKinematics> kinematics_;  // if the robot's URDF is given
  fri::Command wanted_;
  fri::Monitoring seen_;  // by the clock
  // Parameters.
  std::string address_ = "127.0.0.1", controller_, mode_text_ = "monitor";
  std::int32_t port_;
  double timeout_ = 0.1, wait_ = 0, dq_cutoff_ = 50, v_command_max_ = 0.25, w_command_max_ = 1,
         ddq_command_max_ = kSafeAcceleration;
  std::vector<double> dq_command_max_;
  // Inputs.
  std::array<double, 6> F_command_{};
  std::array<double, 3> p_command_{};
  std::array<double, 4> quat_command_{1, 0, 0, 0};
  KrlPorts krl_command_;
  IoPorts writes_;
  // Tunables.
  bool command_ = true, tau_e_gated_ = false;
  std::vector<double> K_P_, K_D_, stiffness_, damping_;
  std::array<double, 6> cartesian_stiffness_{}, cartesian_damping_{};
  // Outputs.
  bool connected_ = false, commanding_ = false;
  std::int32_t state_ = 0, quality_ = 0, command_mode_ = 0;
  double t_robot_ = 0, period_ = 0;
  std::vector<double> q_robot_, q_own_, q_sent_, e_;
  std::array<double, 6> F_e_{};
  std::array<double, 3> p_{};
  std::array<double, 4> quat_{1, 0, 0, 0};
  KrlPorts krl_;
  IoPorts reads_;
  ClientCounts counts_;
  std::int32_t losses_ = 0;  // of the connection
  std::int32_t refused_ = 0, unsent_ = 0, restarts_ = 0;
  double lost_time_ = 0;
  // Of the session.
  std::int64_t host_ = 0, at_ = 0;  // ns: of the last step on the monotonic clock and in the scenario
  std::int64_t position_ = -1;      // in the stream, of the message measured last; −1: none
  std::int64_t offered_ = -1;       // of the last message, measured or not; −1: none
  std::int64_t answered_ = -1;      // of the message answered last; −1: none
  bool following_ = false;          // the robot takes commands; else its own position is mirrored
  bool follows_ = false;            // and they are those of the inputs
  bool begins_ = false;             // the next answer begins where the robot is: the first of a session, or after a jump
  bool own_ = false;                // the last set point was that of the robot's own motion
  fri::Joints set_point_before_{};  // rad, commanded in the message that was answered last
  int followed_ = 0;                // takes_, since commands began
  double offered_period_ = 0;       // s, of the last message, measured or not
  bool yields_ = false;             // the robot is impedance-controlled: its set point may be elsewhere
  std::int64_t believed_at_ = 0;    // ns, scenario time of that message, or of the beginning of the session
  std::uint64_t sessions_ = 0;
  bool was_connected_ = false;
  bool waiting_ = false;  // for the first message, in the initialisation
  Inputs inputs_;
  Heard heard_;
  std::span<const std::uint8_t> answer_;  // to the newest message, in client_; empty: none is due
  std::int64_t repeat_at_ = 0;            // ns, CLOCK_MONOTONIC: of the next repetition
  bool refuses_ = false;                  // the robot takes commands, but not those of the mode
};

}  // namespace cotwin::io
