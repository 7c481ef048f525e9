#pragma once
#include "models/identification/feasible.h"
#include "models/identification/log_cholesky.h"
#include "models/identification/problem.h"
#include "models/identification/stiffness.h"
#include "models/identification/swarm_search.h"
#include "models/identification/torque_data/preparation.h"
#include "models/identification/torque_data/torque_data.h"
#include "models/identification/torque_data/torque_model.h"

/// Identification of a robot's dynamics from measured joint torques (IV-A4), in five steps:
///   Samples s = prepare(q, dq, tau);              filtered signals and accelerations
///   TorqueData data(robot); data.add(s);          compressed by QR, once; the number of samples no longer matters
///   Problem problem(data, robot);                 weights, floor, excitation, bounds about the prior
///   SwarmSearch search(problem); search.run();    the swarm; beside it solve_feasible(problem) and problem.floor()
///   with_bodies(robot, search.estimate(), "…");   a robot again; estimate().drive has friction and motor inertia
