static __device__ inline long long rem_i64(long long a, long long b)
{
    return b == 0 ? a : b == -1 ? 0 : a % b;
}

extern "C" __global__ void run_all(
    const double *__restrict__ state_start,
    const double *__restrict__ damping,
    const long long *__restrict__ steps,
    const long long *__restrict__ every,
    double *__restrict__ log_,
    double *__restrict__ end,
    const long long runs)
{
    const long long run = (long long)blockIdx.x * blockDim.x + threadIdx.x;
    if (run >= runs) {
        return;
    }
    long long v1 = 0;
    double v2 = state_start[run];
    double v3 = state_start[runs + run];
    for (long long i = 0; i < steps[0]; ++i) {
        const bool v4 = rem_i64(i, every[0]) == 0;
        if (v4) {
            log_[(v1 * 2 + 0) * runs + run] = v2;
            log_[(v1 * 2 + 1) * runs + run] = v3;
        }
        const double v5 = v3 - 0.01 * (sin(v2) + damping[0] * v3);
        v1 = v1 + (v4 ? 1 : 0);
        v2 = v2 + 0.01 * v5;
        v3 = v5;
    }

    end[run] = v2;
    end[runs + run] = v3;
}
