#include "models/collision/contact/detector.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

#include "models/collision/contact/narrow_phase.h"
#include "models/collision/contact/patch.h"
#include "models/collision/separation.h"

namespace cotwin::collision {

using Eigen::Vector3d;

struct Detector::Impl {
  struct Bounds {
    Vector3d low, high;
    std::uint32_t piece;
  };
  struct Candidate {
    std::uint64_t bodies, pieces;  // in each: the smaller index in the upper half
    friend auto operator<=>(const Candidate&, const Candidate&) = default;
  };

  explicit Impl(const scene::Scene& scene);
  void detect(std::span<const Pose> X_WB, double margin);
  void update(std::span<const Pose> X_WB, double margin, std::span<const char> moved);
  bool place(std::uint32_t piece, const Pose& X_WB, Bounds& box);
  void place(std::span<const Pose> X_WB);
  void place_fixed(std::span<const Pose> X_WB);
  void sweep(double margin);
  void add_candidate(std::uint32_t i, std::uint32_t j);
  bool ignores(std::uint32_t a, std::uint32_t b) const {
    const std::pair both(a, b);
    return std::binary_search(ignored.begin(), ignored.end(), both) || std::ranges::find(joined, both) != joined.end();
  }
  void add_points(const Candidate& candidate, double margin);

  std::vector<Piece> pieces;
  std::vector<std::uint32_t> planes;                             // pieces
  std::vector<std::pair<std::uint32_t, std::uint32_t>> ignored;  // bodies, sorted
  std::vector<std::pair<std::uint32_t, std::uint32_t>> joined;   // by latches, as `ignored`

  std::vector<Placed> placed;         // in the world
  std::vector<std::uint32_t> moving;  // pieces of bodies that are not static
  std::vector<char> absent;           // per piece: of a tool that is not there
  std::vector<std::size_t> fixed_bodies;
  std::vector<Pose> seen;           // at which the fixed pieces were placed; empty: not yet
  std::vector<Bounds> fixed, wide;  // of static pieces but planes, sorted along x
  double widest = 0;                // along x, of `fixed`
  std::vector<Bounds> bounds;       // of moving pieces, sorted along the sweep
  std::vector<Candidate> candidates, candidates_before;
  std::vector<std::size_t> ends, ends_before;  // of each candidate's points
  NarrowPhase narrow_phase;
  Patch patch;
  std::vector<ManifoldPoint> touches;
  std::vector<ContactPoint> points, points_before;
};

Detector::Impl::Impl(const scene::Scene& scene) {
  std::size_t corners = 0;
  for (std::size_t b = 0; b < scene.bodies.size(); ++b) {
    const scene::Body& body = scene.bodies[b];
    if (body.motion == scene::Motion::kStatic) fixed_bodies.push_back(b);
    for (std::size_t s = 0; s < body.shapes.size(); ++s) {
      const scene::Material& material = body.shapes[s].material;
      Piece piece{make_convex(body.shapes[s]),           static_cast<int>(b),     static_cast<int>(s),
                  body.motion != scene::Motion::kStatic, material.foundation > 0, material.soft()};
      if (piece.moves) moving.push_back(static_cast<std::uint32_t>(pieces.size()));
      if (piece.convex.core == Core::kPlane) planes.push_back(static_cast<std::uint32_t>(pieces.size()));
      corners = std::max(corners, most_corners(piece.convex));
      pieces.push_back(std::move(piece));
      absent.push_back(body.shapes[s].tool.empty() ? 0 : 1);
    }
  }
  const auto tool_of = [&](const Piece& piece) -> const std::string& {
    return scene.bodies[static_cast<std::size_t>(piece.body)].shapes[static_cast<std::size_t>(piece.shape)].tool;
  };
  for (std::size_t first = 0; first < pieces.size();) {
    std::size_t last = first;
    std::vector<Convex> own;
    for (; last < pieces.size() && pieces[last].body == pieces[first].body && tool_of(pieces[last]) == tool_of(pieces[first]);
         ++last)
      own.push_back(std::move(pieces[last].convex));
    find_covered_faces(own);
    for (Convex& convex : own) pieces[first++].convex = std::move(convex);
  }
  const auto ignore = [&](int a, int b) {
    if (a >= 0 && b >= 0 && a != b)
      ignored.emplace_back(static_cast<std::uint32_t>(std::min(a, b)), static_cast<std::uint32_t>(std::max(a, b)));
  };
  for (const auto& [a, b] : scene.no_contact) ignore(a, b);
  for (const scene::Joint& joint : scene.joints) ignore(joint.parent, joint.child);
  std::sort(ignored.begin(), ignored.end());
  joined.reserve(scene.latches.size());
  placed.resize(pieces.size());
  for (std::size_t i = 0; i < pieces.size(); ++i) placed[i].convex = &pieces[i].convex;
  bounds.reserve(moving.size());
  seen.reserve(scene.bodies.size());
  fixed.reserve(pieces.size());
  wide.reserve(pieces.size());
  narrow_phase.reserve(corners);
  patch.reserve(corners);
  touches.reserve(8);
}

bool Detector::Impl::place(std::uint32_t i, const Pose& X, Bounds& box) {
  const Piece& piece = pieces[i];
  placed[i].R.noalias() = X.R * piece.convex.X_BC.R;
  placed[i].p = X * piece.convex.X_BC.p;
  if (piece.convex.core == Core::kPlane) return false;
  const Vector3d half = half_sizes(piece.convex, placed[i].R);
  box = {placed[i].p - half, placed[i].p + half, i};
  return box.low.allFinite() && box.high.allFinite();
}

void Detector::Impl::place(std::span<const Pose> X_WB) {
  const bool stay =
      !seen.empty() && std::all_of(fixed_bodies.begin(), fixed_bodies.end(), [&](std::size_t b) { return seen[b] == X_WB[b]; });
  if (!stay) place_fixed(X_WB);
  bounds.clear();
  Bounds box;
  for (const std::uint32_t i : moving) {
    if (absent[i] == 0 && place(i, X_WB[static_cast<std::size_t>(pieces[i].body)], box)) bounds.push_back(box);
  }
}

/// Sorts the pieces of static bodies along x; those much wider than most are in a list of their own.
void Detector::Impl::place_fixed(std::span<const Pose> X_WB) {
  seen.assign(X_WB.begin(), X_WB.end());
  fixed.clear();
  wide.clear();
  widest = 0;
  Bounds box;
  for (std::uint32_t i = 0; i < pieces.size(); ++i) {
    if (!pieces[i].moves && place(i, X_WB[static_cast<std::size_t>(pieces[i].body)], box)) fixed.push_back(box);
  }
  if (fixed.empty()) return;
  const auto width = [](const Bounds& b) { return b.high.x() - b.low.x(); };
  const auto middle = fixed.begin() + static_cast<std::ptrdiff_t>(fixed.size() / 2);
  std::nth_element(fixed.begin(), middle, fixed.end(), [&](const Bounds& a, const Bounds& b) { return width(a) < width(b); });
  constexpr double kWide = 4;  // times the median
  const double limit = kWide * width(*middle);
  for (const Bounds& b : fixed) {
    if (width(b) > limit) wide.push_back(b);
  }
  std::erase_if(fixed, [&](const Bounds& b) { return width(b) > limit; });
  for (const Bounds& b : fixed) widest = std::max(widest, width(b));
  std::sort(fixed.begin(), fixed.end(), [](const Bounds& a, const Bounds& b) { return a.low.x() < b.low.x(); });
}

void Detector::Impl::add_candidate(std::uint32_t i, std::uint32_t j) {
  const Piece *a = &pieces[i], *b = &pieces[j];
  if (a->body == b->body || (!a->moves && !b->moves)) return;
  if (i > j) std::swap(i, j), std::swap(a, b);
  const auto body_a = static_cast<std::uint32_t>(a->body), body_b = static_cast<std::uint32_t>(b->body);
  if (ignores(body_a, body_b)) return;
  candidates.push_back({std::uint64_t{body_a} << 32 | body_b, std::uint64_t{i} << 32 | j});
}

/// Sweep and prune along x over the moving pieces, then of each against the fixed ones; planes are tested against all pieces.
void Detector::Impl::sweep(double margin) {
  candidates.clear();
  std::sort(bounds.begin(), bounds.end(), [](const Bounds& a, const Bounds& b) {
    return a.low.x() != b.low.x() ? a.low.x() < b.low.x() : a.piece < b.piece;
  });
  for (std::size_t i = 0; i < bounds.size(); ++i) {
    const Bounds& a = bounds[i];
    const Vector3d low = a.low.array() - margin, high = a.high.array() + margin;
    for (std::size_t j = i + 1; j < bounds.size() && bounds[j].low.x() < high.x(); ++j) {
      const Bounds& b = bounds[j];
      // Sums of the four, not &&: branches are unpredictable here.
      const int along_y = int{b.low.y() < high.y()} + int{b.high.y() > low.y()};
      const int along_z = int{b.low.z() < high.z()} + int{b.high.z() > low.z()};
      if (along_y + along_z == 4) add_candidate(a.piece, b.piece);
    }
    const auto meet = [&](const Bounds& b) {
      const bool apart = (b.low.array() >= high.array()).any() || (b.high.array() <= low.array()).any();
      if (!apart) add_candidate(a.piece, b.piece);
    };
    for (const Bounds& b : wide) meet(b);
    auto b = std::lower_bound(fixed.begin(), fixed.end(), low.x() - widest,
                              [](const Bounds& one, double x) { return one.low.x() < x; });
    for (; b != fixed.end() && b->low.x() < high.x(); ++b) meet(*b);
  }
  for (const std::uint32_t plane : planes) {
    const Vector3d n = placed[plane].R.col(2);
    for (const Bounds& b : bounds) {
      const double lowest = n.dot(b.low + b.high) / 2 - n.cwiseAbs().dot(b.high - b.low) / 2 - n.dot(placed[plane].p);
      if (lowest < margin) add_candidate(plane, b.piece);
    }
  }
  std::sort(candidates.begin(), candidates.end());
}

void Detector::Impl::add_points(const Candidate& candidate, double margin) {
  const auto i = static_cast<std::uint32_t>(candidate.pieces >> 32), j = static_cast<std::uint32_t>(candidate.pieces);
  const Core core = placed[i].convex->core;
  const Vector3d origin = core == Core::kPlane ? placed[j].p : placed[i].p;
  const Placed a{placed[i].convex, placed[i].R, placed[i].p - origin}, b{placed[j].convex, placed[j].R, placed[j].p - origin};
  const bool yields = pieces[i].foundation || pieces[j].foundation, prefer_b = pieces[j].foundation && !pieces[i].foundation;
  const Vector3d n = narrow_phase.find(a, b, margin, touches);
  if (!touches.empty() && yields) patch.find(a, b, prefer_b, n, margin, touches);
  std::sort(touches.begin(), touches.end(), [](const ManifoldPoint& s, const ManifoldPoint& t) { return s.id < t.id; });
  for (const ManifoldPoint& t : touches) {
    points.push_back({pieces[i].body, pieces[j].body, pieces[i].shape, pieces[j].shape, origin + t.p, t.n, t.gap, t.id, t.area,
                      t.share, t.load, t.spread});
  }
}

void Detector::Impl::detect(std::span<const Pose> X_WB, double margin) {
  points.clear();
  ends.clear();
  place(X_WB);
  sweep(margin);
  for (const Candidate& candidate : candidates) {
    add_points(candidate, margin);
    ends.push_back(points.size());
  }
}

void Detector::Impl::update(std::span<const Pose> X_WB, double margin, std::span<const char> moved) {
  std::swap(points, points_before);
  std::swap(candidates, candidates_before);
  std::swap(ends, ends_before);
  points.clear();
  ends.clear();
  place(X_WB);
  sweep(margin);
  std::size_t k = 0;
  for (const Candidate& candidate : candidates) {
    while (k < candidates_before.size() && candidates_before[k] < candidate) ++k;
    const auto body_a = static_cast<std::uint32_t>(candidate.bodies >> 32),
               body_b = static_cast<std::uint32_t>(candidate.bodies);
    if (k < candidates_before.size() && candidates_before[k] == candidate && moved[body_a] == 0 && moved[body_b] == 0) {
      const auto from = points_before.begin();
      points.insert(points.end(), from + static_cast<std::ptrdiff_t>(k == 0 ? 0 : ends_before[k - 1]),
                    from + static_cast<std::ptrdiff_t>(ends_before[k]));
    } else {
      add_points(candidate, margin);
    }
    ends.push_back(points.size());
  }
}

Detector::Detector(const scene::Scene& scene) : impl_(std::make_unique<Impl>(scene)) {}
Detector::~Detector() = default;
Detector::Detector(Detector&&) noexcept = default;
Detector& Detector::operator=(Detector&&) noexcept = default;

void Detector::detect(std::span<const Pose> X_WB, double margin) { impl_->detect(X_WB, margin); }
void Detector::update(std::span<const Pose> X_WB, double margin, std::span<const char> moved) {
  impl_->update(X_WB, margin, moved);
}
void Detector::set_present(int body, int shape, bool present) {
  for (std::size_t i = 0; i < impl_->pieces.size(); ++i) {
    if (impl_->pieces[i].body == body && impl_->pieces[i].shape == shape) impl_->absent[i] = present ? 0 : 1;
  }
}

std::span<const Detector::Piece> Detector::pieces() const { return impl_->pieces; }
void Detector::clear_joined() { impl_->joined.clear(); }
void Detector::add_joined(int body_a, int body_b) {
  const auto [low, high] = std::minmax(body_a, body_b);
  impl_->joined.emplace_back(static_cast<std::uint32_t>(low), static_cast<std::uint32_t>(high));
}
bool Detector::ignores(int body_a, int body_b) const {
  const auto [low, high] = std::minmax(body_a, body_b);
  return impl_->ignores(static_cast<std::uint32_t>(low), static_cast<std::uint32_t>(high));
}
std::span<const ContactPoint> Detector::points() const { return impl_->points; }
void Detector::reserve(std::size_t points) {
  impl_->touches.reserve(points);
  for (auto* list : {&impl_->points, &impl_->points_before}) list->reserve(points);
  for (auto* list : {&impl_->candidates, &impl_->candidates_before}) list->reserve(points);
  for (auto* list : {&impl_->ends, &impl_->ends_before}) list->reserve(points);
}

}  // namespace cotwin::collision
