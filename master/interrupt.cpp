#include "master/interrupt.h"

#include <csignal>

namespace cotwin::master {

std::atomic<int> stop_signal{0};

void catch_signals() {
  struct sigaction action = {};
  action.sa_handler = [](int signal) { stop_signal = signal; };
  action.sa_flags = SA_RESETHAND;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

}  // namespace cotwin::master
