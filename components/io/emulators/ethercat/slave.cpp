#include "components/io/emulators/ethercat/slave.h"

#include <algorithm>
#include <map>
#include <string>
#include <utility>

#include "models/foundation/support/error.h"

namespace cotwin::ethercat {

namespace {

constexpr std::uint16_t kAssignment = 0x1c10;     // + number of the sync manager
constexpr std::size_t kMostAssigned = 16;         // PDOs of one sync manager
constexpr std::uint32_t kModularDevice = 0x1389;  // device type 5001

bool is_state(std::uint16_t value) { return value == 1 || value == 2 || value == 3 || value == 4 || value == 8; }

std::string image_name(std::span<const std::uint8_t> image) {
  return "SII image of " + std::to_string(image.size()) + " bytes";
}

void copy_bits(std::span<const std::uint8_t> from, std::size_t begin, std::span<std::uint8_t> to, std::size_t bits) {
  std::fill(to.begin(), to.end(), std::uint8_t{0});
  for (std::size_t i = 0; i < bits && (begin + i) / 8 < from.size() && i / 8 < to.size(); ++i) {
    const int bit = from[(begin + i) / 8] >> ((begin + i) % 8) & 1;
    to[i / 8] = static_cast<std::uint8_t>(to[i / 8] | bit << (i % 8));
  }
}

}  // namespace

Slave::Slave(std::vector<std::uint8_t> image, const SlaveOptions& options)
    : sii_(read_sii(image, image_name(image))),
      options_(options),
      esc_(options.esc, std::move(image)),
      copies_states_(options.copies_states.value_or((sii_.pdi_control & 0x0100) != 0)),
      outputs_(kLongestFrame),
      inputs_(kLongestFrame) {
  if (sii_.sync_managers.size() > static_cast<std::size_t>(esc_.sync_manager_count())) {
    throw Error("emulated slave " + sii_.general.order, std::to_string(sii_.sync_managers.size()) +
                                                            " sync managers in its SII, expected at most " +
                                                            std::to_string(esc_.sync_manager_count()));
  }
  if ((sii_.protocols & mailbox_protocol::kCoE) && sii_.mailbox.out_size != 0) {
    make_objects();
    coe_.emplace(objects_, static_cast<ObjectOwner&>(*this), sii_.mailbox.out_size, sii_.mailbox.in_size);
  }
  for (auto& list : assigned_) list.reserve(std::max<std::size_t>(kMostAssigned, sii_.rx_pdos.size() + sii_.tx_pdos.size()));
  measure_process_data();
}

void Slave::power_on(std::int64_t now) {
  esc_.reset(now);
  state_ = State::kInit;
  wanted_.reset();
  objects_.restore();
  if (coe_) coe_->reset();
  reply_ = sent_ = {};
  measure_process_data();
  std::fill(outputs_.begin(), outputs_.end(), std::uint8_t{0});
  std::fill(inputs_.begin(), inputs_.end(), std::uint8_t{0});
  restart();
  update(now);
}

bool Slave::process(std::span<std::uint8_t> frame, std::int64_t now) {
  advance(now);
  const bool forwarded = esc_.process(frame, now);
  serve(now);
  return forwarded;
}

void Slave::advance(std::int64_t now) {
  esc_.advance(now);
  serve(now);
}

void Slave::serve(std::int64_t now) {
  serve_state(now);
  if (coe_) serve_mailbox();
  exchange();
  update(now);
  if (state_ != State::kSafeOp && state_ != State::kOp) return;
  std::size_t at = 0;
  for (int n = 0; n < static_cast<int>(sii_.sync_managers.size()); ++n) {
    if (!is(n, SyncManagerType::kInputs)) continue;
    const std::size_t size = expected_length(n);
    esc_.set_inputs(n, std::span(inputs_).subspan(at, size));
    at += size;
  }
}

/// Outputs of the master, or zeros.
void Slave::exchange() {
  const bool valid = state_ == State::kOp && outputs_arrive();
  std::size_t at = 0;
  for (int n = 0; n < static_cast<int>(sii_.sync_managers.size()); ++n) {
    if (!is(n, SyncManagerType::kOutputs)) continue;
    const std::size_t size = expected_length(n);
    const auto from = esc_.outputs(n);
    if (valid && from.size() == size) {
      std::copy(from.begin(), from.end(), outputs_.begin() + static_cast<std::ptrdiff_t>(at));
    } else {
      std::fill_n(outputs_.begin() + static_cast<std::ptrdiff_t>(at), size, std::uint8_t{0});
    }
    at += size;
  }
}

// ------------------------------------------------------------------------------------------------------------------ states

void Slave::enter(State state, AlCode code) {
  if (state != state_ && state == State::kInit && coe_) {
    coe_->reset();
    reply_ = sent_ = {};
  }
  state_ = state;
  wanted_.reset();
  esc_.set_al_status(static_cast<std::uint16_t>(static_cast<unsigned>(state) | (code == AlCode::kNone ? 0 : kStateError)),
                     code);
}

void Slave::serve_state(std::int64_t now) {
  if (esc_.pop_al_request()) {
    const std::uint16_t control = esc_.al_control(), value = control & kStateBits;
    if (copies_states_) {
      if (is_state(value)) state_ = static_cast<State>(value);
      esc_.set_al_status(control & (kStateBits | kStateError), AlCode::kNone);
    } else if (has_error() && !(control & kStateError) && value > static_cast<std::uint16_t>(state_)) {
      // An error that is not acknowledged blocks higher states.
    } else if (!is_state(value)) {
      enter(state_, AlCode::kUnknownState);
    } else if (const auto next = static_cast<State>(value); next == state_) {
      enter(state_, AlCode::kNone);
    } else if (const AlCode code = change_to(next); code != AlCode::kNone) {
      enter(state_, code);
    } else {
      if (has_error()) enter(state_, AlCode::kNone);
      wanted_ = next;
      wanted_at_ = now + options_.state_time;
      wanted_until_ = wanted_at_ + options_.outputs_wait;
    }
  }
  if (copies_states_) return;
  if (wanted_ && now >= wanted_at_) {
    if (*wanted_ != State::kOp || outputs_arrive()) {
      enter(*wanted_, AlCode::kNone);
    } else if (now >= wanted_until_) {
      enter(state_, AlCode::kNoOutputs);
    }
  }
  if (state_ != State::kSafeOp && state_ != State::kOp) return;
  if (const AlCode code = check_process_data(); code != AlCode::kNone) {
    enter(State::kPreOp, code);
  } else if (state_ == State::kOp && output_bytes_ != 0 && esc_.watchdog_expired()) {
    enter(State::kSafeOp, AlCode::kWatchdog);
  }
}

AlCode Slave::change_to(State wanted) const {
  switch (wanted) {
    case State::kInit:
      return AlCode::kNone;
    case State::kBootstrap:
      if (state_ != State::kInit) return AlCode::kInvalidChange;
      return sii_.bootstrap.out_size == 0
                 ? AlCode::kNoBootstrap
                 : (check_mailbox(sii_.bootstrap) == AlCode::kNone ? AlCode::kNone : AlCode::kMailboxBootstrap);
    case State::kPreOp:
      if (state_ == State::kBootstrap) return AlCode::kInvalidChange;
      return state_ == State::kInit && sii_.mailbox.out_size != 0 ? check_mailbox(sii_.mailbox) : AlCode::kNone;
    case State::kSafeOp:
      if (state_ == State::kOp) return AlCode::kNone;
      return state_ == State::kPreOp ? check_process_data() : AlCode::kInvalidChange;
    case State::kOp:
      return state_ == State::kSafeOp ? AlCode::kNone : AlCode::kInvalidChange;
  }
  return AlCode::kUnknownState;
}

AlCode Slave::check_mailbox(const SiiMailbox& mailbox) const {
  const int out = find(SyncManagerType::kMailboxOut), in = find(SyncManagerType::kMailboxIn);
  if (out < 0 || in < 0) return AlCode::kMailbox;
  const auto& o = esc_.sync_manager(out);
  const auto& i = esc_.sync_manager(in);
  const bool good = o.enabled && o.mailbox() && o.master_writes() && o.start == mailbox.out && o.length == mailbox.out_size &&
                    i.enabled && i.mailbox() && !i.master_writes() && i.start == mailbox.in && i.length == mailbox.in_size;
  return good ? AlCode::kNone : AlCode::kMailbox;
}

AlCode Slave::check_process_data() const {
  for (int n = 0; n < static_cast<int>(sii_.sync_managers.size()); ++n) {
    const bool outputs = is(n, SyncManagerType::kOutputs);
    if (!outputs && !is(n, SyncManagerType::kInputs)) continue;
    const std::size_t size = expected_length(n);
    const auto& s = esc_.sync_manager(n);
    const bool good =
        size == 0 ? !s.enabled || s.length == 0 : s.enabled && !s.mailbox() && s.master_writes() == outputs && s.length == size;
    if (!good) return outputs ? AlCode::kOutputs : AlCode::kInputs;
  }
  return AlCode::kNone;
}

bool Slave::outputs_arrive() const {
  if (esc_.watchdog_expired()) return false;
  for (int n = 0; n < static_cast<int>(sii_.sync_managers.size()); ++n) {
    if (is(n, SyncManagerType::kOutputs) && expected_length(n) != 0 && !esc_.sync_manager(n).ever_written) return false;
  }
  return true;
}

// ----------------------------------------------------------------------------------------------------------------- mailbox

void Slave::serve_mailbox() {
  if (state_ == State::kInit || state_ == State::kBootstrap) return;
  const int out = find(SyncManagerType::kMailboxOut), in = find(SyncManagerType::kMailboxIn);
  if (out < 0 || in < 0) return;
  if (esc_.repeat_requested(in)) {
    esc_.acknowledge_repeat(in);
    if (!sent_.empty()) esc_.put_mail(in, sent_);
  }
  if (reply_.empty()) reply_ = coe_->next_part();
  if (reply_.empty()) {
    const auto mail = esc_.read_mail(out);
    if (!mail.empty()) reply_ = coe_->answer(mail);
  }
  if (!reply_.empty() && esc_.put_mail(in, reply_)) sent_ = std::exchange(reply_, {});
}

void Slave::make_objects() {
  using namespace object_type;
  objects_.add(0x1000, 0, "Device type", kU32, 32, kModularDevice);
  objects_.add_text(0x1008, 0, "Device name", sii_.general.order);
  objects_.add(0x1018, 0, "Identity", kU8, 8, 4);
  objects_.add(0x1018, 1, "Vendor ID", kU32, 32, sii_.vendor);
  objects_.add(0x1018, 2, "Product code", kU32, 32, sii_.product);
  objects_.add(0x1018, 3, "Revision", kU32, 32, sii_.revision);
  objects_.add(0x1018, 4, "Serial number", kU32, 32, sii_.serial);
  objects_.add(0x1c00, 0, "Sync manager type", kU8, 8, sii_.sync_managers.size());
  for (std::size_t n = 0; n < sii_.sync_managers.size(); ++n) {
    const auto sub = static_cast<std::uint8_t>(n + 1);
    const SyncManagerType type = sii_.sync_managers[n].type;
    objects_.add(0x1c00, sub, "Type", kU8, 8, static_cast<std::uint64_t>(type));
    if (type != SyncManagerType::kOutputs && type != SyncManagerType::kInputs) continue;
    const auto index = static_cast<std::uint16_t>(kAssignment + n);
    const std::vector<Pdo>& pdos = type == SyncManagerType::kOutputs ? sii_.rx_pdos : sii_.tx_pdos;
    std::vector<std::uint16_t> list;
    for (const Pdo& p : pdos) {
      if (p.sync_manager == n && list.size() < kMostAssigned) list.push_back(p.index);
    }
    const bool writable = pdos.size() > list.size();
    objects_.add(index, 0, "PDO assignment", kU8, 8, list.size(), writable);
    list.resize(writable ? std::min(pdos.size(), kMostAssigned) : list.size());
    for (std::size_t i = 0; i < list.size(); ++i) {
      objects_.add(index, static_cast<std::uint8_t>(i + 1), "PDO", kU16, 16, list[i], writable);
    }
  }
  std::map<std::pair<std::uint16_t, std::uint8_t>, const PdoEntry*> widest;  // an object can be in PDOs with different lengths
  for (const std::vector<Pdo>* pdos : {&sii_.rx_pdos, &sii_.tx_pdos}) {
    for (const Pdo& p : *pdos) {
      if (objects_.has(p.index)) continue;  // the same PDO twice in the image
      objects_.add(p.index, 0, p.name, kU8, 8, p.entries.size());
      for (std::size_t i = 0; i < p.entries.size(); ++i) {
        const PdoEntry& e = p.entries[i];
        objects_.add(p.index, static_cast<std::uint8_t>(i + 1), e.name, kU32, 32,
                     static_cast<std::uint64_t>(e.index) << 16 | static_cast<std::uint64_t>(e.subindex) << 8 | e.bits);
        if (e.index == 0 || e.bits == 0 || e.bits > 64) continue;
        const PdoEntry*& known = widest[{e.index, e.subindex}];
        if (!known || known->bits < e.bits) known = &e;
      }
    }
  }
  for (const auto& [key, e] : widest) {
    if (!objects_.find(e->index, e->subindex)) objects_.add(e->index, e->subindex, e->name, e->type, e->bits, 0);
  }
  // Subindex 0 of the objects with process data: the highest subindex.
  std::vector<std::pair<std::uint16_t, std::uint8_t>> highest;
  for (const ObjectEntry& e : objects_.entries()) {
    if (highest.empty() || highest.back().first != e.index) highest.emplace_back(e.index, e.subindex);
    highest.back().second = e.subindex;
  }
  for (const auto& [index, last] : highest) {
    if (!objects_.find(index, 0)) objects_.add(index, 0, "Subindex 000", kU8, 8, last);
  }
}

void Slave::refresh(const ObjectEntry& entry) {
  std::size_t begin[2] = {0, 0};  // bits of inputs and outputs that were passed
  for (int n = 0; n < static_cast<int>(sii_.sync_managers.size()); ++n) {
    const bool outputs = is(n, SyncManagerType::kOutputs);
    if (!outputs && !is(n, SyncManagerType::kInputs)) continue;
    std::size_t at = begin[outputs];
    for (const Pdo* const p : assigned_[static_cast<std::size_t>(n)]) {
      for (const PdoEntry& e : p->entries) {
        if (e.index == entry.index && e.subindex == entry.subindex && e.index != 0) {
          copy_bits(outputs ? outputs_ : inputs_, at, objects_.bytes(entry), e.bits);
        }
        at += e.bits;
      }
    }
    begin[outputs] += 8 * expected_length(n);
  }
}

SdoAbort Slave::check(const ObjectEntry& entry, std::span<const std::uint8_t> value) {
  std::uint64_t number = 0;
  for (std::size_t i = 0; i < std::min<std::size_t>(value.size(), 8); ++i)
    number |= static_cast<std::uint64_t>(value[i]) << (8 * i);
  if (entry.index < kAssignment || entry.index >= kAssignment + sii_.sync_managers.size()) return SdoAbort::kNone;
  const SdoAbort code = check_assignment(entry.index - kAssignment, entry, number);
  if (code == SdoAbort::kNone) {
    objects_.set_number(entry.index, entry.subindex, number);
    measure_process_data();
  }
  return code;
}

SdoAbort Slave::check_assignment(int n, const ObjectEntry& entry, std::uint64_t value) const {
  if (state_ != State::kPreOp) return SdoAbort::kState;
  if (entry.subindex == 0) {
    if (value > kMostAssigned || (value != 0 && !objects_.find(entry.index, static_cast<std::uint8_t>(value))))
      return SdoAbort::kRange;
    for (std::uint8_t i = 1; i <= value; ++i) {
      const std::uint64_t index = objects_.number(entry.index, i);
      if (!pdo(static_cast<std::uint16_t>(index))) return SdoAbort::kNotMappable;
      for (std::uint8_t k = 1; k < i; ++k) {
        if (objects_.number(entry.index, k) == index) return SdoAbort::kNotMappable;
      }
    }
    return SdoAbort::kNone;
  }
  if (objects_.number(entry.index, 0) != 0) return SdoAbort::kSubindex0;
  const std::vector<Pdo>& pdos = is(n, SyncManagerType::kOutputs) ? sii_.rx_pdos : sii_.tx_pdos;
  const bool known = std::any_of(pdos.begin(), pdos.end(), [&](const Pdo& p) { return p.index == value; });
  return known || value == 0 ? SdoAbort::kNone : SdoAbort::kNotMappable;
}

// ------------------------------------------------------------------------------------------------------------ process data

bool Slave::is(int n, SyncManagerType type) const { return sii_.sync_managers[static_cast<std::size_t>(n)].type == type; }

int Slave::find(SyncManagerType type) const {
  for (int n = 0; n < static_cast<int>(sii_.sync_managers.size()); ++n) {
    if (is(n, type)) return n;
  }
  return -1;
}

const Pdo* Slave::pdo(std::uint16_t index) const {
  for (const std::vector<Pdo>* pdos : {&sii_.rx_pdos, &sii_.tx_pdos}) {
    for (const Pdo& p : *pdos) {
      if (p.index == index) return &p;
    }
  }
  return nullptr;
}

/// The PDOs of sync manager n in their order: from the assignment object, or without CoE from the image.
void Slave::list_assigned(int n) {
  std::vector<const Pdo*>& list = assigned_[static_cast<std::size_t>(n)];
  list.clear();
  if (coe_) {
    const auto index = static_cast<std::uint16_t>(kAssignment + n);
    const auto count = objects_.number(index, 0);
    for (std::uint8_t i = 1; i <= count; ++i) {
      if (const Pdo* const p = pdo(static_cast<std::uint16_t>(objects_.number(index, i)))) list.push_back(p);
    }
    return;
  }
  for (const Pdo& p : is(n, SyncManagerType::kOutputs) ? sii_.rx_pdos : sii_.tx_pdos) {
    if (p.sync_manager == n) list.push_back(&p);
  }
}

std::optional<std::size_t> Slave::place_of(std::uint16_t wanted) const {
  std::size_t bytes[2] = {0, 0};  // of inputs and outputs that were passed
  std::optional<std::size_t> found;
  for (int n = 0; n < static_cast<int>(sii_.sync_managers.size()); ++n) {
    const bool outputs = is(n, SyncManagerType::kOutputs);
    if (!outputs && !is(n, SyncManagerType::kInputs)) continue;
    std::size_t at = 8 * bytes[outputs];
    for (const Pdo* const p : assigned_[static_cast<std::size_t>(n)]) {
      if (p->index == wanted) found = at;
      at += p->bits();
    }
    bytes[outputs] += expected_length(n);
  }
  return found;
}

std::size_t Slave::expected_length(int n) const { return lengths_[static_cast<std::size_t>(n)]; }

/// The lengths of the sync managers follow from their PDOs; without any the image gives them.
void Slave::measure_process_data() {
  output_bytes_ = input_bytes_ = 0;
  for (int n = 0; n < static_cast<int>(sii_.sync_managers.size()); ++n) {
    std::size_t& length = lengths_[static_cast<std::size_t>(n)];
    length = 0;
    const bool outputs = is(n, SyncManagerType::kOutputs);
    if (!outputs && !is(n, SyncManagerType::kInputs)) continue;
    std::size_t bits = 0;
    list_assigned(n);
    for (const Pdo* const p : assigned_[static_cast<std::size_t>(n)]) bits += p->bits();
    length = (bits + 7) / 8;
    const std::vector<Pdo>& pdos = outputs ? sii_.rx_pdos : sii_.tx_pdos;
    const bool by_pdos = std::any_of(pdos.begin(), pdos.end(), [&](const Pdo& p) { return p.sync_manager == n; });
    if (bits == 0 && !by_pdos) length = sii_.sync_managers[static_cast<std::size_t>(n)].length;
    std::size_t& total = outputs ? output_bytes_ : input_bytes_;
    length = std::min(length, kLongestFrame - total);
    total += length;
  }
}

}  // namespace cotwin::ethercat
