#include "coordinator/integrate/energy.h"

#include <math.h>

#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

enum { LIMBS = 4 };

double kiln_exact_unit(double scale)
{
    if (!(scale > 0.0) || !isfinite(scale))
        return 0x1p-80;
    int exponent;
    (void)frexp(scale, &exponent);
    return ldexp(1.0, exponent - 82 > -1000 ? exponent - 82 : -1000);
}

int kiln_exact_reduce(MPI_Comm communicator, struct kiln_exact_sum *sums, size_t count, struct kiln_error *error)
{
    int64_t *limbs = NULL;
    const int status = kiln_agree(
        communicator, kiln_allocate(&limbs, count * LIMBS, sizeof *limbs, "the sums over ranks", error), error);
    if (status != KILN_OK) {
        kiln_free(&limbs);
        return status;
    }
    for (size_t i = 0; i < count; i++) { /* 32 bits a limb, the highest signed: sums over 2^31 ranks do not overflow */
        __int128 rest = sums[i].value;
        for (int k = 0; k < LIMBS - 1; k++) {
            limbs[i * LIMBS + (size_t)k] = (int64_t)(rest & 0xffffffff);
            rest >>= 32;
        }
        limbs[i * LIMBS + LIMBS - 1] = (int64_t)rest;
    }
    (void)MPI_Allreduce(MPI_IN_PLACE, limbs, (int)(count * LIMBS), MPI_INT64_T, MPI_SUM, communicator);
    for (size_t i = 0; i < count; i++) {
        sums[i].value = 0;
        for (int k = LIMBS - 1; k >= 0; k--)
            sums[i].value = sums[i].value * ((__int128)1 << 32) + limbs[i * LIMBS + (size_t)k];
    }
    kiln_free(&limbs);
    return KILN_OK;
}
