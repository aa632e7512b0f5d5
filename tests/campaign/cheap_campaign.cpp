#include "campaign/cheap_campaign.hpp"

namespace lumo {

template class GaussianProcess<>;
template class Optimizer<RbfKernel, LogNehvi, FreshCandidates>;
template class CampaignState<Optimizer<RbfKernel, LogNehvi, FreshCandidates>>;

}  // namespace lumo
