#pragma once
#include "models/numerics/second_order.h"

namespace cotwin::compliance {

using numerics::acceleration;
using numerics::advance;
using numerics::Deviation;
using numerics::SecondOrder;

}  // namespace cotwin::compliance
