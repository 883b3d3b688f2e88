#include <stdlib.h>

#include "coordinator/cli/commands.h"

/* Makes threads of parallel loops sleep while they wait, unless the environment says otherwise. While one thread reads,
 * writes or builds, spinning threads would take processors from it, from other ranks and from Embree. The OpenMP
 * library reads the setting once, in a constructor without a priority (GCC) or at the first loop (LLVM). */
__attribute__((constructor(101))) static void choose_how_threads_wait(void)
{
    (void)setenv("OMP_WAIT_POLICY", "passive", 0);
}

int main(int argc, char **argv) { return kiln_main(argc, argv); }
