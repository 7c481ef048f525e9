#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "components/io/ethercat/master/sequence.h"
#include "components/io/ethercat/master/slave_setup.h"

/// Values that a master downloads over CoE while it sets up a slave, such as the limits of a drive: from a file, and as datagrams.
namespace cotwin::ethercat {

/// A value for the slave with this name.
struct StartUpRow {
  std::string slave;
  StartUpValue value;
};

/// Reads a list of start-up values, what the InitCmds of an ENI are: a line `slave,when,index,subindex,type,value` per value, after a
/// line with these words. Lines that begin with # and empty lines are left out.
///   slave            name of the slave
///   when             PS: in PREOP, before the slave goes to SAFEOP; SO: in SAFEOP, before it goes to OP
///   index, subindex  0x6065 or 24677
///   type             u8, i8, u16, i16, u32, i32, f32, f64, text, or bytes in hexadecimal digits ("01 ff")
///   value            of the type; the rest of the line
/// Throws Error `place:line: …` for a line that does not fit, a value out of the range of its type, and for objects that assign and
/// map PDOs (0x1600 to 0x17ff, 0x1a00 to 0x1bff, 0x1c10 to 0x1c2f): these follow from the ports.
std::vector<StartUpRow> read_start_up(std::string_view text, const std::string& place);

/// Appends the datagrams that download `value` through the mailboxes of the slave at `station`: the request, a wait until the answer is in
/// the mailbox, the answer, and the same for each segment of a value that is longer than a mail. `client`: one for all values of a
/// slave, because a slave takes a mail with the counter of the last one for its repetition.
void append_download(std::vector<Step>& steps, std::uint16_t station, const SiiMailbox& box, SdoClient& client,
                     const StartUpValue& value);

}  // namespace cotwin::ethercat
