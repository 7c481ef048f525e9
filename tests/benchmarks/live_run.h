#pragma once

/// What watching a run costs its loop.
void live_run_costs();
