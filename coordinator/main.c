#include <stdlib.h>

#include "coordinator/cli/commands.h"

/* Threads of parallel loops sleep while they wait, unless the environment says otherwise: while one thread reads,
 * writes or builds, others would take the processor from it, from the other ranks and from Embree's threads. OpenMP's
 * library reads this once, in a constructor without a priority (GCC) or with the first loop (LLVM). */
__attribute__((constructor(101))) static void choose_how_threads_wait(void)
{
    (void)setenv("OMP_WAIT_POLICY", "passive", 0);
}

int main(int argc, char **argv) { return kiln_main(argc, argv); }
