/* The end of the launcher (mpirun, or its daemon on this host) ends the ranks that it started.
 *
 * MPI libraries promise that, but a rank that is told so while it is already ending, or that holds a lock of the
 * library, may stay for ever. A thread that calls no MPI looks once a second whether the process still has the parent
 * that it began with, and ends the process a few seconds after it has lost it. */
#ifndef KILN_COORDINATOR_MPI_LAUNCHER_H
#define KILN_COORDINATOR_MPI_LAUNCHER_H

/* Call it once, before MPI_Init, in a process that a launcher has started. The thread lasts as long as the process;
 * where it cannot be started, there is none. A process that has lost its parent ends with KILN_RANK_LOST. */
void kiln_launcher_watch(void);

#endif
