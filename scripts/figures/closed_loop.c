/* Runs of a compiled closed loop; called by closed_loop.py, compiled with its `first` and `step`. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#define RESULTS 4

void first(const double *values, double *state);
void step(const double *values, const double *state, double *after, double *seen);

/* One run. The largest error and the samples outside from sample `since` on, if the run ends outside or is not finite,
   and the largest error of the last `tail` samples. `seen` has errors and both sides of the envelope, one after the
   other. */
static void run(const double *values, int size, int joints, int samples, int since, int tail, double *results)
{
    double *state = malloc(size * sizeof(double)), *after = malloc(size * sizeof(double));
    double *seen = malloc(3 * joints * sizeof(double)), peak = 0.0, steady = 0.0;
    int outside = 0, left = 0, broken = 0;
    first(values, state);
    for (int k = 0; k < samples; k++) {
        double largest = 0.0, *other = state;
        step(values, state, after, seen);
        left = 0;
        for (int j = 0; j < joints; j++) {
            broken |= !isfinite(seen[j]);
            left |= !(seen[j] > seen[joints + j] && seen[j] < seen[2 * joints + j]);
            largest = fmax(largest, fabs(seen[j]));
        }
        peak = k >= since ? fmax(peak, largest) : peak;
        steady = k >= samples - tail ? fmax(steady, largest) : steady;
        outside += k >= since && left;
        state = after;
        after = other;
    }
    free(state), free(after), free(seen);
    results[0] = broken ? INFINITY : peak;
    results[1] = outside;
    results[2] = left || broken;
    results[3] = broken ? INFINITY : steady;
}

/* Arguments: numbers of runs, values, state, joints, samples, samples of the tail, and workers. A row of the standard
   input is the first sample that counts, and the values; the standard output has `RESULTS` numbers of each run. */
int main(int count, char **words)
{
    int a[7];
    if (count != 8)
        return 1;
    for (int k = 0; k < 7; k++)
        a[k] = atoi(words[k + 1]);
    const int runs = a[0], width = a[1] + 1;
    double *rows = malloc(sizeof(double) * runs * width);
    if (fread(rows, sizeof(double), (size_t)runs * width, stdin) != (size_t)runs * width)
        return 1;
    const size_t length = sizeof(double) * (RESULTS * runs + 1);
    double *results = mmap(0, length, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    int *next = (int *)(results + RESULTS * runs);
    for (int worker = 0; worker < a[6]; worker++)
        if (!fork()) {
            int i;
            while ((i = __sync_fetch_and_add(next, 1)) < runs)
                run(rows + i * width + 1, a[2], a[3], a[4], (int)rows[i * width], a[5], results + RESULTS * i);
            _exit(0);
        }
    int status, failed = 0;
    while (wait(&status) > 0)
        failed |= status;
    fwrite(results, sizeof(double), RESULTS * runs, stdout);
    return failed != 0;
}
