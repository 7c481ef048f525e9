#include "tests/benchmarks/dynamics_peers.h"

#include <mujoco/mujoco.h>

#include <Eigen/Cholesky>
#include <array>
#include <cstdio>
#include <kdl/chaindynparam.hpp>
#include <kdl/chainfdsolver_recursive_newton_euler.hpp>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainidsolver_recursive_newton_euler.hpp>
#include <kdl/chainjnttojacsolver.hpp>

#include "tests/benchmarks/kdl_chain.h"

namespace cotwin::benchmark {
namespace {

class Kdl final : public DynamicsPeer {
 public:
  Kdl(const robot::RobotModel& robot, const States& states)
      : chain_(kdl_chain(robot)),
        inverse_(chain_, kdl(robot.gravity)),
        parameters_(chain_, kdl(robot.gravity)),
        pose_(chain_),
        jacobian_(chain_),
        forward_(chain_, kdl(robot.gravity)),
        no_wrenches_(chain_.getNrOfSegments(), KDL::Wrench::Zero()),
        result_(chain_.getNrOfJoints()),
        mass_(static_cast<int>(chain_.getNrOfJoints())),
        jac_(chain_.getNrOfJoints()) {
    for (std::size_t s = 0; s < states.q.size(); ++s) {
      q_.push_back(array(states.q[s]));
      dq_.push_back(array(states.dq[s]));
      ddq_.push_back(array(states.ddq[s]));
      tau_.push_back(array(states.tau[s]));
    }
  }
  std::string name() const override { return "KDL"; }
  void inverse_dynamics(std::size_t s) override {
    inverse_.CartToJnt(q_[s], dq_[s], ddq_[s], no_wrenches_, result_);
    out = result_.data;
  }
  void mass_matrix(std::size_t s) override {
    parameters_.JntToMass(q_[s], mass_);
    M = mass_.data;
  }
  void jacobian(std::size_t s) override {
    KDL::Frame tip;
    pose_.JntToCart(q_[s], tip);
    jacobian_.JntToJac(q_[s], jac_);
    J = jac_.data;
  }
  void forward_dynamics(std::size_t s) override {
    forward_.CartToJnt(q_[s], dq_[s], tau_[s], no_wrenches_, result_);
    out = result_.data;
  }

 private:
  static KDL::JntArray array(const Eigen::VectorXd& v) {
    KDL::JntArray a(static_cast<unsigned>(v.size()));
    a.data = v;
    return a;
  }

  KDL::Chain chain_;
  KDL::ChainIdSolver_RNE inverse_;
  KDL::ChainDynParam parameters_;
  KDL::ChainFkSolverPos_recursive pose_;
  KDL::ChainJntToJacSolver jacobian_;
  KDL::ChainFdSolver_RNE forward_;
  KDL::Wrenches no_wrenches_;
  KDL::JntArray result_;
  KDL::JntSpaceInertiaMatrix mass_;
  KDL::Jacobian jac_;
  std::vector<KDL::JntArray> q_, dq_, ddq_, tau_;
};

// MuJoCo computes in stages on its data; each function here runs the stages that it needs.
class MuJoCoDynamics final : public DynamicsPeer {
 public:
  MuJoCoDynamics(mjModel* model, const robot::RobotModel& robot, const States& states)
      : states_(states), model_(model), data_(mj_makeData(model)) {
    body_ = mj_name2id(model, mjOBJ_BODY, robot.bodies.back().name.c_str());
    out.resize(model->nv);
    M.resize(model->nv, model->nv);
    J.resize(6, model->nv);
    rows_.resize(6, model->nv);
  }
  ~MuJoCoDynamics() override {
    mj_deleteData(data_);
    mj_deleteModel(model_);
  }
  MuJoCoDynamics(const MuJoCoDynamics&) = delete;
  MuJoCoDynamics& operator=(const MuJoCoDynamics&) = delete;
  std::string name() const override { return "MuJoCo"; }

  void inverse_dynamics(std::size_t s) override {
    place(s);
    mj_crb(model_, data_);  // mj_inverse computes it too: mj_rne adds the joints' armature from it
    move(s);
    mju_copy(data_->qacc, states_.ddq[s].data(), model_->nv);
    mj_rne(model_, data_, 1, out.data());
  }
  void mass_matrix(std::size_t s) override {
    place(s);
    mj_crb(model_, data_);
    mj_fullM(model_, M.data(), data_->qM);
  }
  void jacobian(std::size_t s) override {
    place(s);
    mj_jacBody(model_, data_, rows_.data(), rows_.data() + 3 * model_->nv, body_);
    J = rows_;
  }
  void forward_dynamics(std::size_t s) override {
    place(s);
    mj_crb(model_, data_);
    mj_factorM(model_, data_);
    move(s);
    mj_rne(model_, data_, 0, data_->qfrc_bias);
    mju_sub(data_->qfrc_smooth, states_.tau[s].data(), data_->qfrc_bias, model_->nv);
    mj_solveM(model_, data_, out.data(), data_->qfrc_smooth, 1);
  }

 private:
  void place(std::size_t s) {
    mju_copy(data_->qpos, states_.q[s].data(), model_->nq);
    mj_kinematics(model_, data_);
    mj_comPos(model_, data_);
  }
  void move(std::size_t s) {
    mju_copy(data_->qvel, states_.dq[s].data(), model_->nv);
    mj_comVel(model_, data_);
  }

  const States& states_;
  mjModel* model_;
  mjData* data_;
  int body_ = 0;
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rows_;  // 6 x n
};

}  // namespace

std::unique_ptr<DynamicsPeer> make_kdl(const robot::RobotModel& robot, const States& states) {
  return std::make_unique<Kdl>(robot, states);
}

std::unique_ptr<DynamicsPeer> make_mujoco_dynamics(const std::string& urdf, const robot::RobotModel& robot,
                                                   const States& states) {
  std::array<char, 500> error{};
  mjModel* model = mj_loadXML(urdf.c_str(), nullptr, error.data(), static_cast<int>(error.size()));
  if (model != nullptr && model->nv == robot.n()) return std::make_unique<MuJoCoDynamics>(model, robot, states);
  std::fprintf(stderr, "MuJoCo does not load %s: %s\n", urdf.c_str(), error.data());
  if (model != nullptr) mj_deleteModel(model);
  return nullptr;
}

}  // namespace cotwin::benchmark
