#include "coordinator/bake/bake_private.h"

#include "coordinator/mpi/agree.h"

int kiln_bake_end_phase(struct kiln_bake *b, int status, struct kiln_error *error)
{
    kiln_phase(&b->phases, "waiting");
    kiln_control_meet(b->control);
    status = kiln_agree(b->communicator, status, error);
    kiln_phase(&b->phases, NULL);
    return status;
}
