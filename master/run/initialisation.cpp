#include "master/run/initialisation.h"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <type_traits>

#include "components/unit/staged_initialisation.h"
#include "models/support/error.h"
#include "models/support/text.h"

namespace cotwin::master {

namespace {

constexpr double kTolerance = 1e-12;  // relative to 1 + |value|
constexpr int kMaxIterations = 200;
constexpr Eigen::Index kDepth = 8;

using Graph = std::vector<std::vector<std::size_t>>;

/// Tarjan's algorithm with an explicit stack instead of recursion, for long chains.
class StrongComponents {
 public:
  explicit StrongComponents(const Graph& edges)
      : edges_(edges), index_(edges.size(), kNone), low_(edges.size()), on_stack_(edges.size()) {
    for (std::size_t node = 0; node < edges.size(); ++node) {
      if (index_[node] == kNone) visit(node);
    }
    std::reverse(found_.begin(), found_.end());  // Tarjan finds sinks first
  }
  std::vector<std::vector<std::size_t>> take() { return std::move(found_); }

 private:
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);
  struct Frame {
    std::size_t node, next_edge;
  };

  void open(std::size_t node) {
    index_[node] = low_[node] = count_++;
    stack_.push_back(node);
    on_stack_[node] = true;
    frames_.push_back({node, 0});
  }

  void visit(std::size_t root) {
    open(root);
    while (!frames_.empty()) {
      const std::size_t node = frames_.back().node;
      if (frames_.back().next_edge < edges_[node].size()) {
        const std::size_t other = edges_[node][frames_.back().next_edge++];
        if (index_[other] == kNone) {
          open(other);
        } else if (on_stack_[other]) {
          low_[node] = std::min(low_[node], index_[other]);
        }
        continue;
      }
      frames_.pop_back();
      if (!frames_.empty()) low_[frames_.back().node] = std::min(low_[frames_.back().node], low_[node]);
      if (low_[node] == index_[node]) close(node);
    }
  }

  void close(std::size_t node) {
    std::vector<std::size_t> component;
    do {
      component.push_back(stack_.back());
      on_stack_[stack_.back()] = false;
      stack_.pop_back();
    } while (component.back() != node);
    std::sort(component.begin(), component.end());
    found_.push_back(std::move(component));
  }

  const Graph& edges_;
  std::vector<std::size_t> index_, low_;
  std::vector<bool> on_stack_;
  std::vector<std::size_t> stack_;
  std::vector<Frame> frames_;
  std::size_t count_ = 0;
  std::vector<std::vector<std::size_t>> found_;
};

class Initialiser {
 public:
  Initialiser(std::span<Member> members, const Schedule& schedule, const std::vector<Link>& links, Wiring& wiring, Time start)
      : members_(members),
        schedule_(schedule),
        links_(links),
        wiring_(wiring),
        start_(start),
        edges_(schedule.slots.size()),
        stages_(schedule.slots.size()) {
    for (const Link& link : links) edges_[schedule.slot_of[link.from.member]].push_back(schedule.slot_of[link.to.member]);
    for (auto& targets : edges_) {
      std::sort(targets.begin(), targets.end());
      targets.erase(std::unique(targets.begin(), targets.end()), targets.end());
    }
  }

  Initialisation run() {
    for (const auto& component : strong_components(edges_)) {
      const std::size_t first = component.front();
      if (component.size() > 1 || std::binary_search(edges_[first].begin(), edges_[first].end(), first)) {
        initialise_cycle(component);
      } else {
        wiring_.update(first);
        initialise(first);
      }
    }
    return result_;
  }

 private:
  const std::string& name(std::size_t slot) const { return members_[schedule_.slots[slot].member].name(); }

  template <class Call>
  void at_component(std::size_t slot, Call call) {
    try {
      call();
    } catch (const Error& error) {
      const ComponentSpec& spec = members_[schedule_.slots[slot].member].spec;
      fail(spec.place, "component '" + spec.name + "': " + error.what());
    }
  }

  /// Initialises with the present inputs; in a cycle repeatedly.
  void initialise(std::size_t slot) {
    at_component(slot, [&] {
      if (stages_[slot] != nullptr) {
        stages_[slot]->update_initialisation();
      } else {
        schedule_.slots[slot].unit->initialise(start_);
      }
    });
  }

  /// Units that support StagedInitialisation stay in their initialisation until the cycle has converged. If leaving it changes
  /// an output of a connection within the cycle, the cycle is iterated once more, with complete initialisations.
  void initialise_cycle(const std::vector<std::size_t>& slots) {
    bool staged = false;
    for (const std::size_t slot : slots) {
      wiring_.update(slot);
      auto* stages = dynamic_cast<StagedInitialisation*>(schedule_.slots[slot].unit);
      if (stages == nullptr) {
        initialise(slot);
      } else {
        at_component(slot, [&] { stages->enter_initialisation(start_); });
        stages_[slot] = stages;
        staged = true;
      }
    }
    converge(slots);
    if (!staged) return;
    const auto sources = sources_within(slots);
    const auto before = values_of(sources);
    for (const std::size_t slot : slots) {
      if (stages_[slot] == nullptr) continue;
      at_component(slot, [&] { stages_[slot]->exit_initialisation(); });
      stages_[slot] = nullptr;
    }
    if (values_of(sources) != before) converge(slots);
  }

  /// The source variables of connections between `slots`, each once.
  std::vector<const Variable*> sources_within(const std::vector<std::size_t>& slots) const {
    const auto within = [&](const Signal& signal) {
      return std::binary_search(slots.begin(), slots.end(), schedule_.slot_of[signal.member]);
    };
    std::vector<const Variable*> sources;
    for (const Link& link : links_) {
      if (within(link.from) && within(link.to)) sources.push_back(link.from.variable);
    }
    std::sort(sources.begin(), sources.end());
    sources.erase(std::unique(sources.begin(), sources.end()), sources.end());
    return sources;
  }

  /// Values as bytes: a NaN equals itself.
  static std::vector<std::string> values_of(const std::vector<const Variable*>& variables) {
    std::vector<std::string> values;
    for (const Variable* variable : variables) {
      std::visit(
          [&](auto span) {
            if constexpr (std::is_same_v<typename decltype(span)::value_type, std::string>) {
              values.insert(values.end(), span.begin(), span.end());
            } else {
              values.emplace_back(reinterpret_cast<const char*>(span.data()), span.size_bytes());
            }
          },
          variable->storage);
    }
    return values;
  }

  void converge(const std::vector<std::size_t>& slots) {
    // Each sweep passes a change along at least one connection.
    std::vector<std::size_t> changing = sweep(slots, slots.size() + 1);
    if (changing.empty()) return;
    const std::vector<std::size_t> loop = loop_among(changing);
    if (!loop.empty()) {
      for (const std::size_t slot : loop) {
        const bool known = std::find(result_.loop.begin(), result_.loop.end(), name(slot)) != result_.loop.end();
        if (!known) result_.loop.push_back(name(slot));
      }
      solve(loop);
    }
    std::vector<std::size_t> rest;
    for (const std::size_t slot : slots) {
      if (!std::binary_search(loop.begin(), loop.end(), slot)) rest.push_back(slot);
    }
    changing = sweep(rest, rest.size() + 1);
    if (!changing.empty()) throw Error("initialisation", "the inputs of '" + name(changing.front()) + "' do not converge");
  }

  /// Sweeps over `slots` until no input changes, at most `rounds` times. Returns the slots that changed in the last sweep.
  std::vector<std::size_t> sweep(const std::vector<std::size_t>& slots, std::size_t rounds) {
    std::vector<std::size_t> changing;
    int made = 1;  // the first initialisation
    for (std::size_t round = 0; round < rounds; ++round) {
      changing.clear();
      for (const std::size_t slot : slots) {
        if (!wiring_.update(slot)) continue;
        changing.push_back(slot);
        initialise(slot);
      }
      ++made;
      if (changing.empty()) break;
    }
    result_.rounds = std::max(result_.rounds, made);
    return changing;
  }

  /// The slots of `changing` that lie on a cycle within it, ascending; the others only follow.
  std::vector<std::size_t> loop_among(const std::vector<std::size_t>& changing) const {
    const auto is_changing = [&](std::size_t slot) { return std::ranges::binary_search(changing, slot); };
    Graph among(edges_.size());
    for (const std::size_t slot : changing)
      std::copy_if(edges_[slot].begin(), edges_[slot].end(), std::back_inserter(among[slot]), is_changing);
    std::vector<std::size_t> loop;
    for (const auto& component : strong_components(among)) {
      const std::size_t first = component.front();
      const bool feeds_itself = std::find(among[first].begin(), among[first].end(), first) != among[first].end();
      if (component.size() > 1 || feeds_itself) loop.insert(loop.end(), component.begin(), component.end());
    }
    std::sort(loop.begin(), loop.end());
    return loop;
  }

  /// Solves x = G(x), x the real inputs of the loop, by Anderson's acceleration (Walker and Ni, SIAM J. Numer. Anal. 49, 2011,
  /// the unconstrained form): the step is the residual f = G(x) − x minus its best approximation by the last changes of f.
  void solve(const std::vector<std::size_t>& loop) {
    std::vector<double*> inputs;
    for (const std::size_t slot : loop) {
      const std::vector<double*> fed = wiring_.fed_reals(slot);
      inputs.insert(inputs.end(), fed.begin(), fed.end());
    }
    const auto n = static_cast<Eigen::Index>(inputs.size());
    const auto read = [&](Eigen::VectorXd& to) {
      for (Eigen::Index i = 0; i < n; ++i) to[i] = *inputs[static_cast<std::size_t>(i)];
    };
    Eigen::VectorXd x(n), g(n), f(n), last_g(n), last_f(n);
    Eigen::MatrixXd df(n, kDepth), dg(n, kDepth);
    const Eigen::Index depth = std::min(kDepth, n);
    read(x);
    double worst = 0;
    std::string worst_slot;
    Eigen::Index columns = 0;
    for (int iteration = 1; iteration <= kMaxIterations; ++iteration) {
      ++result_.iterations;
      for (Eigen::Index i = 0; i < n; ++i) *inputs[static_cast<std::size_t>(i)] = x[i];
      for (const std::size_t slot : loop) initialise(slot);
      bool changed = false;
      for (const std::size_t slot : loop) changed = wiring_.update(slot) || changed;
      if (!changed) return;
      read(g);
      f = g - x;
      if (!f.allFinite()) break;
      worst = n > 0 ? (f.array().abs() / (1 + x.array().abs())).maxCoeff() : 1;
      if (worst <= kTolerance) {  // the inputs are G(x) now: compute the outputs from them
        for (const std::size_t slot : loop) initialise(slot);
        return;
      }
      if (iteration > 1) {
        const Eigen::Index at = (iteration - 2) % std::max<Eigen::Index>(depth, 1);
        df.col(at) = f - last_f;
        dg.col(at) = g - last_g;
        columns = std::min(columns + 1, depth);
      }
      last_f = f;
      last_g = g;
      x = g;
      if (columns > 0) {
        const Eigen::VectorXd gamma = df.leftCols(columns).colPivHouseholderQr().solve(f);
        if (gamma.allFinite()) x -= dg.leftCols(columns) * gamma;
      }
    }
    std::string members;
    for (const std::size_t slot : loop) members += (members.empty() ? "" : ", ") + name(slot);
    throw Error("initialisation", "algebraic loop between " + members + ": its inputs do not converge within " +
                                      std::to_string(kMaxIterations) + " iterations (last relative change " +
                                      text::to_text(worst, 3) + "); set start values closer to a solution, or break the loop");
  }

  std::span<Member> members_;
  const Schedule& schedule_;
  const std::vector<Link>& links_;
  Wiring& wiring_;
  Time start_;
  Graph edges_;
  std::vector<StagedInitialisation*> stages_;  // per slot; nullptr: not in a staged initialisation
  Initialisation result_{.rounds = 1, .loop = {}, .iterations = 0};
};

}  // namespace

std::vector<std::vector<std::size_t>> strong_components(const Graph& edges) { return StrongComponents(edges).take(); }

Initialisation initialise_units(std::span<Member> members, const Schedule& schedule, const std::vector<Link>& links,
                                Wiring& wiring, Time start) {
  return Initialiser(members, schedule, links, wiring, start).run();
}

}  // namespace cotwin::master
