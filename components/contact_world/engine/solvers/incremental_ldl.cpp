#include "components/contact_world/engine/solvers/incremental_ldl.h"
#include "components/contact_world/engine/solvers/numbers.h"

#include <algorithm>

namespace cotwin::contact_world {
namespace {

// Two elements at a time in two partial sums, a reordering that the compiler may not do. Rows have no alignment.
using Two [[gnu::vector_size(16)]] = double;
using TwoInPlace [[gnu::aligned(8), gnu::may_alias]] = Two;

double paired_dot(const double* a, const double* b, int n) {
  Two s = {0, 0}, t = {0, 0};
  int i = 0;
  for (; i + 4 <= n; i += 4) {
    s += *reinterpret_cast<const TwoInPlace*>(a + i) * *reinterpret_cast<const TwoInPlace*>(b + i);
    t += *reinterpret_cast<const TwoInPlace*>(a + i + 2) * *reinterpret_cast<const TwoInPlace*>(b + i + 2);
  }
  s += t;
  double sum = s[0] + s[1];
  for (; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

}  // namespace

void IncrementalLdl::reserve(int n) {
  const std::size_t size = index(n);
  if (size <= stride_) return;
  stride_ = size;
  L_.resize((size + 1) * size);  // one more slot for the candidate
  d_.resize(size);
  d_inverse_.resize(size);
  p_.resize(size);
  beta_.resize(size);
  first_.resize(size);
  row_.resize(size);
  position_.resize(size);
  slot_.resize(size + 1);
  clear(0);
}

void IncrementalLdl::clear(int n) {
  reserve(n);
  m_ = ascending_ = 0;
  candidate_ = -1;
  std::fill_n(position_.begin(), n, -1);
  for (std::size_t i = 0; i <= index(n) && i < slot_.size(); ++i) slot_[i] = i;  // including the candidate's
}

double IncrementalLdl::pivot(int i, const double* a, double diagonal, RowProfile profile) {
  // Solves L D l = A_Fi by rows; l stores y = D l meanwhile, from its first nonzero element.
  double* l = L(m_);
  int first = m_;
  const auto rows = row_.begin();
  for (auto k = static_cast<int>(std::lower_bound(rows, rows + ascending_, profile.begin) - rows); k < m_; ++k) {
    const int j = row_[index(k)];
    l[k] = j >= profile.begin && j < profile.end ? a[j] : 0;
    if (first == m_ && l[k] != 0) first = k;
  }
  double d = diagonal;
  for (int k = first; k < m_; ++k) {
    const int begin = std::max(first, first_[index(k)]);
    if (begin < k) l[k] -= paired_dot(L(k) + begin, l + begin, k - begin);
  }
  for (int k = first; k < m_; ++k) {
    const double y = l[k];
    l[k] = y * d_inverse_[index(k)];
    d -= y * l[k];
  }
  candidate_ = i;
  candidate_first_ = first;
  candidate_d_ = d;
  return d;
}

void IncrementalLdl::column(double* z) const {
  std::fill(z, z + candidate_first_, 0.0);
  std::copy(L(m_) + candidate_first_, L(m_) + m_, z + candidate_first_);
  for (int k = m_ - 1; k > 0; --k) {  // Lᵀ z = l
    const double* row = L(k);
    const double zk = z[k];
    if (zk == 0) continue;
    for (int j = first_[index(k)]; j < k; ++j) z[j] -= row[j] * zk;
  }
}

void IncrementalLdl::append() {
  if (ascending_ == m_ && (m_ == 0 || row_[index(m_ - 1)] < candidate_)) ++ascending_;
  first_[index(m_)] = candidate_first_;
  d_[index(m_)] = candidate_d_;
  d_inverse_[index(m_)] = 1 / candidate_d_;
  row_[index(m_)] = candidate_;
  position_[index(candidate_)] = m_;
  ++m_;
}

void IncrementalLdl::remove(int i) {
  // Without row and column k, the rows below keep their part left of k; right of it
  //   L' D' L'ᵀ = L D Lᵀ + d_k l lᵀ,  l = L(·, k)
  // [Gill, Golub, Murray, Saunders 1974, method C1], here row by row.
  const int k = position_[index(i)];
  double alpha = d_[index(k)];
  for (int r = k + 1; r < m_; ++r) {
    double* row = L(r);
    double w = 0;
    int first = first_[index(r)];
    if (first <= k) w = row[k];
    for (int j = std::max(first, k + 1); j < r; ++j) {
      w -= p_[index(j)] * row[j];
      row[j - 1] = row[j] + beta_[index(j)] * w;
    }
    if (first > k) --first;
    const double d = d_[index(r)], d_new = d + alpha * w * w;
    p_[index(r)] = w;
    beta_[index(r)] = alpha * w / d_new;
    alpha *= d / d_new;
    d_[index(r - 1)] = d_new;
    d_inverse_[index(r - 1)] = 1 / d_new;
    first_[index(r - 1)] = first;
    row_[index(r - 1)] = row_[index(r)];
    position_[index(row_[index(r)])] = r - 1;
  }
  const std::size_t freed = slot_[index(k)];
  std::copy(slot_.begin() + k + 1, slot_.begin() + m_ + 1, slot_.begin() + k);  // also moves the candidate's slot
  slot_[index(m_)] = freed;
  position_[index(i)] = -1;
  candidate_ = -1;
  if (k < ascending_) --ascending_;
  --m_;
}

void IncrementalLdl::solve(double* v) const {
  for (int k = 1; k < m_; ++k) {
    const int begin = first_[index(k)];
    if (begin < k) v[k] -= paired_dot(L(k) + begin, v + begin, k - begin);
  }
  for (int k = 0; k < m_; ++k) v[k] *= d_inverse_[index(k)];
  for (int k = m_ - 1; k > 0; --k) {
    const double* row = L(k);
    const double vk = v[k];
    if (vk == 0) continue;
    for (int j = first_[index(k)]; j < k; ++j) v[j] -= row[j] * vk;
  }
}

}  // namespace cotwin::contact_world
